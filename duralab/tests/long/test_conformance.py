"""The conformance check: green on what keeps the contract, red at the right line on what breaks it, gentle on all."""

import contextlib
import ctypes
import json
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import synthetic_campaign
from fake_gateway import Defect, Gateway
from typer.testing import CliRunner

import duralab_bus
from duralab.cli.application import app
from duralab.conformance import Outcome, all_passed, check_rig
from duralab.conformance.refusal_checks import GENTLE, beyond_limit, gentle_drive, jump
from duralab.data import RigMode
from duralab.errors import StoppedError
from duralab.lab import Lab
from duralab_proto.v1 import array_pb2, rig_pb2

SECONDS = 1.2

#: The first line that must fail, and what its sentence must say.
EXPECTED = {
    Defect.OTHER_NAME: ("description.figures", "the description is of 'another'"),
    Defect.HASH: ("description.figures", "content_hash is '42'"),
    Defect.UNIT_OF_KIND: ("description.channels", "response 'left_lateral' is in 'kN'"),
    Defect.LIMITS: ("description.channels", "limits are finite and in order"),
    Defect.STATIC: ("description.figures", "one finite value for each response"),
    Defect.CHANGING: ("description.stable", "another one when asked again"),
    Defect.LATCHED: ("state.idle", "RIG_MODE_INTERLOCKED (somebody was here)"),
    Defect.TAKES_RATE: ("refuse.sample_rate", "was played; it must be refused with FAULT_CODE_INVALID_ARGUMENT"),
    Defect.TAKES_COUNT: ("refuse.channel_count", "was played"),
    Defect.TAKES_ORDER: ("refuse.channel_order", "was played"),
    Defect.TAKES_UNIT: ("refuse.unit", "was played"),
    Defect.TAKES_NAN: ("refuse.not_finite", "was played"),
    Defect.TAKES_EMPTY: ("refuse.empty", "was played"),
    Defect.TAKES_NAME: ("refuse.run_name", "was played"),
    Defect.TAKES_JUMP: ("refuse.jump", "was played"),
    Defect.TAKES_LIMIT: ("refuse.limit", "was played"),
    Defect.TAKES_TWICE: ("refuse.run_twice", "played again"),
    Defect.TAKES_WHILE_BUSY: ("stop", "a second drive while one plays was played"),
    Defect.TAKES_WHILE_LATCHED: ("refuse.interlocked", "was played"),
    Defect.NO_FIELD: ("refuse.sample_rate", "with the field ''"),
    Defect.WRONG_CODE: ("refuse.sample_rate", "was refused with INTERNAL"),
    Defect.SHORT_RESPONSE: ("play", "the response has 239 samples; the drive had 240"),
    Defect.NAN_RESPONSE: ("play", "nan"),
    Defect.HURRIES: ("play", "although real time was asked for"),
    Defect.LOSES_BLOCK: ("play.stream", "signal blocks came"),
    Defect.FORGETS_BLOCK: ("play.stream", "were lost that the rig keeps no longer"),
    Defect.NUMBERS_BLOCKS: ("play.stream", "signal blocks came"),
    Defect.GAP_IN_SAMPLES: ("play.stream", "begins at sample 21; 20 is due"),
    Defect.NO_LAST: ("play.stream", "`last` is not set"),
    Defect.OTHER_STREAM: ("play.stream", "not the one in the result"),
    Defect.LARGE_BLOCKS: ("play.stream", "has 40 samples"),
    Defect.NEVER_PLAYING: ("play.state", "never said that it plays"),
    Defect.NO_STATES: ("play.state", "never said that it plays"),
    Defect.NO_POSES: ("play.poses", "no pose came"),
    Defect.BAD_QUATERNION: ("play.poses", "not of length 1"),
    Defect.STOP_DOES_NOT_LATCH: ("stop", "instead of RIG_MODE_INTERLOCKED"),
    Defect.STOP_WITHOUT_REASON: ("stop", "the latch has the reason ''"),
    Defect.STOP_GIVES_RESULT: ("stop.cancelled", "answered with a result"),
    Defect.DROPS_DEAD: ("stop.ramp_down", "it must ramp to 0"),
    Defect.RESET_DOES_NOTHING: ("reset", "instead of an idle rig"),
    # Not as a rig that does not refuse a second drive with BUSY.
    Defect.PUBLISHES_LATE: ("stop", "publish them while it plays, or say publishes_after_run in the description"),
    Defect.STOP_DOES_NOT_WAIT: ("stop", "answer when it rests, or say cannot_be_stopped in the description"),
    Defect.STOP_CLAIMS_REST: ("stop", "as if the rig rested, and it cannot be stopped; name the run that goes on"),
    Defect.STOP_IS_FORGOTTEN: ("stop.state", "the latch must stay until a reset"),
    Defect.UNSTOPPABLE_STOPS: ("stop.cancelled", "a playback that cannot be stopped ended with CANCELLED"),
}


#: Rigs that keep the contract and answer at the end only.
AT_THE_END = {
    "rig_later": {"publishes_after_run": True},
    "rig_onward": {"cannot_be_stopped": True},
    "rig_later_and_onward": {"publishes_after_run": True, "cannot_be_stopped": True},
}


@pytest.fixture(scope="module")
def hall():
    """A client of a bus with a gateway for every defect and kind of rig, its address, and the gateways of each kind."""
    with duralab_bus.open_bus(service="rig_sim", workers=16) as served:
        for defect in Defect:
            Gateway(served, f"rig_{defect}", defect)
        at_the_end = {rig: Gateway(served, rig, Defect.NONE, **kind) for rig, kind in AT_THE_END.items()}
        connect = duralab_bus.BusConfig(connect=tuple(served.listening))
        with duralab_bus.open_bus(connect, service="duralab") as bus:
            rigs = {*(f"rig_{defect}" for defect in Defect), *AT_THE_END}
            bus.wait_for_live({("rig_sim", rig) for rig in rigs}, 120.0)
            yield bus, served.listening[0], at_the_end


@pytest.fixture(scope="module")
def findings(hall):
    """What was found on every gateway; five at once: most of it is waiting, and a busy machine answers late."""

    def check(defect):
        found = check_rig(hall[0], f"rig_{defect}", seconds=SECONDS)
        for _ in range(2):
            if not any("this process was too slow to stop" in finding.sentence for finding in found):
                break
            # What the check itself says to do where the machine was too busy for its own process.
            found = check_rig(hall[0], f"rig_{defect}", seconds=3.0 * SECONDS)
        return found

    with ThreadPoolExecutor(5) as pool:
        return dict(zip(Defect, pool.map(check, Defect), strict=True))


def test_a_gateway_that_keeps_the_contract_passes(findings):
    assert [finding for finding in findings[Defect.NONE] if finding.outcome is not Outcome.PASSED] == []
    assert len(findings[Defect.NONE]) >= 28


@pytest.mark.parametrize("rig", AT_THE_END)
def test_a_rig_that_answers_at_the_end_keeps_the_contract_where_its_description_says_so(hall, rig):
    found = check_rig(hall[0], rig, seconds=SECONDS)
    assert [finding for finding in found if finding.outcome is not Outcome.PASSED] == []


@pytest.mark.parametrize("playback", [1, 2], ids=["played", "stopped"])
def test_a_pause_of_this_process_is_no_fault_of_the_rig(hall, playback):
    bus, playing, runs = hall[0], threading.Event(), {}

    def on_state(item):
        if item.message.mode == rig_pb2.RIG_MODE_PLAYING:
            runs[item.message.run] = None
            if len(runs) == playback:
                playing.set()

    def pause():
        assert playing.wait(60.0)
        # A call through PyDLL keeps the interpreter's lock: nothing of this process runs meanwhile. Below the
        # lease of 2 s: after that the other side ends the link, and a query that was sent has an unknown end.
        ctypes.PyDLL(None).usleep(1_500_000)

    states = bus.subscribe(bus.keys.rig_state("rig_none"), rig_pb2.RigState, on_state)
    with contextlib.closing(states), ThreadPoolExecutor(1) as pool:
        paused = pool.submit(pause)
        found = check_rig(bus, "rig_none", seconds=SECONDS)
        paused.result()
    assert [finding for finding in found if finding.outcome is Outcome.FAILED] == []


def test_every_defect_has_its_line():
    assert set(EXPECTED) == set(Defect) - {Defect.NONE}


@pytest.mark.parametrize("defect", EXPECTED, ids=str)
def test_what_breaks_the_contract_fails_at_its_line(findings, defect):
    failed = [finding for finding in findings[defect] if finding.outcome is Outcome.FAILED]
    assert failed, "it passed"
    check, said = EXPECTED[defect]
    assert (failed[0].check, said in failed[0].sentence) == (check, True), failed[0]
    assert all(finding.sentence for finding in findings[defect] if finding.outcome is not Outcome.PASSED)


def test_a_rig_that_is_not_idle_is_left_alone(findings):
    after = [f.outcome for f in findings[Defect.LATCHED] if f.check.startswith(("play", "stop", "refuse", "reset"))]
    assert set(after) == {Outcome.NOT_TRIED}


def test_a_rig_that_plays_what_it_must_refuse_is_not_asked_for_a_jump(findings):
    outcomes = {finding.check: finding.outcome for finding in findings[Defect.TAKES_RATE]}
    assert outcomes["refuse.jump"] is outcomes["refuse.limit"] is Outcome.NOT_TRIED


def test_a_rig_that_is_not_there_fails_at_once(hall):
    found = check_rig(hall[0], "nobody")
    assert (found[0].check, found[0].outcome) == ("live", Outcome.FAILED)
    assert not all_passed(found)
    assert {finding.outcome for finding in found[1:]} == {Outcome.NOT_TRIED}


def test_drives_are_gentle_or_wrong_in_one_way_only():
    told = synthetic_campaign.description()
    told.drives.add(name="speed", unit="m/s", kind=array_pb2.CHANNEL_KIND_VELOCITY, minimum=0.0, maximum=60.0)
    limits = np.array([channel.maximum for channel in told.drives])
    drive = gentle_drive(told, 2.0)
    assert drive.shape == (7, 2000)
    assert (np.abs(drive).max(axis=1) <= GENTLE * limits).all()
    assert np.abs(drive).max(axis=1).min() > 0.0
    assert (np.abs(np.diff(drive[:6], prepend=0.0)) * 1000.0 <= GENTLE * 2.0 + 1e-12).all()
    assert (drive[6] >= 0.0).all()
    beyond = beyond_limit(told)
    assert limits[0] < beyond[0].max() < 1.03 * limits[0]
    assert np.abs(np.diff(beyond, prepend=0.0)).max() * 1000.0 < 2.0
    step = jump(told)
    assert np.abs(np.diff(step, prepend=0.0)).max() * 1000.0 == pytest.approx(2.1)
    assert np.abs(step).max() < 0.1 * limits[0]


def test_the_command_prints_a_line_for_each_check_or_json(hall):
    shown = CliRunner().invoke(app, ["check-rig", "rig_none", "--connect", hall[1]])
    assert shown.exit_code == 0, shown.output
    assert "keeps the contract" in shown.stdout
    assert shown.stdout.count("passed") >= 28
    broken = CliRunner().invoke(app, ["check-rig", "rig_hash", "--connect", hall[1], "--json"])
    assert broken.exit_code == 1
    document = json.loads(broken.stdout)
    assert (document["rig"], document["passed"]) == ("rig_hash", False)
    failed = [finding for finding in document["findings"] if finding["outcome"] == "failed"]
    assert [finding["check"] for finding in failed] == ["description.figures"]


def test_a_latched_rig_is_reset_from_the_command_line(hall):
    said = CliRunner().invoke(app, ["reset", "rig_latched", "--connect", hall[1]])
    assert (said.exit_code, said.stdout) == (
        0,
        "rig_latched was interlocked (somebody was here); it is idle now.\n",
    )
    again = CliRunner().invoke(app, ["reset", "rig_latched", "--connect", hall[1]])
    assert "was not interlocked; it is idle now" in again.stdout


def test_nothing_that_listens_is_one_sentence_and_exit_code_two():
    result = CliRunner().invoke(app, ["check-rig", "front_axle", "--connect", "tcp/127.0.0.1:1"])
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1


def test_a_playback_that_cannot_be_stopped_is_never_told_as_stopped(hall, tmp_path):
    lab, cancel = Lab(hall[0], out=tmp_path), threading.Event()
    drive, words = np.zeros((6, 600)), "The run 'onward' cannot be stopped and goes on to its end."

    def stop(_progress):
        cancel.set()

    may_end = hall[2]["rig_onward"].may_end
    may_end.clear()
    with pytest.raises(StoppedError) as caught:
        lab.play("rig_onward", drive, run="onward", real_time=True, cancel=cancel, on_progress=stop)
    assert f"{words} The rig is latched from then on: wait for its end" in str(caught.value)
    state = lab.stop_rig("rig_onward")
    assert (state.mode, state.run, state.goes_on, state.resting) == (RigMode.INTERLOCKED, "onward", True, False)
    assert words in str(state)
    shown = CliRunner().invoke(app, ["status", "--connect", hall[1]], env={"COLUMNS": "300"})
    may_end.set()
    assert words in shown.stdout
    assert lab.reset("rig_onward").mode is RigMode.IDLE
