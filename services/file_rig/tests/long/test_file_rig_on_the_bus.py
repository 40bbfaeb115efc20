"""file_rig as a process: a drive goes out as a file and its response comes back, whatever is killed meanwhile."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from file_lab import WAIT, Controller, close_to, gentle, truth, until

from duralab_bus import FaultError
from duralab_proto.v1 import rig_pb2


@pytest.fixture
def pool():
    with ThreadPoolExecutor(1) as pool:
        yield pool


@pytest.mark.parametrize("kill", [True, False])
def test_the_wait_survives_the_end_of_the_gateway_and_nothing_is_asked_twice(lab, pool, kill):
    drive = gentle(seed=1)
    asked = pool.submit(lab.play, "two", drive)
    state = lab.waits()
    assert (state.run, state.reason) == ("two", "the response file two.rsp")
    written = (lab.outbox / "two.drv").stat().st_mtime_ns
    lab.end(kill=kill)
    with pytest.raises(FaultError):
        asked.result(WAIT)
    # The response comes while neither the gateway nor its commander is there.
    with Controller(lab.map).running() as controller:
        until((lab.inbox / "two.rsp").exists)
        lab.start()
        with pytest.raises(FaultError, match=r"run 'two', of another drive, waits for its response; play two\.drv"):
            lab.play("three", gentle(seed=2))
        assert (lab.outbox / "two.drv").stat().st_mtime_ns == written
        close_to(lab.play("two-2", drive), truth(drive))
        assert controller.played == ["two"]
        # Its answer was lost: the next attempt gets the same response, another playback is another motion.
        close_to(lab.play("two-3", drive), truth(drive))
        assert controller.played == ["two"]
        close_to(lab.play("repeated", drive), truth(drive))
        lab.play("two-4", drive, seed=2)
        assert controller.played == ["two", "repeated", "two-4"]


def test_who_takes_up_the_wait_of_another_run_gets_a_lost_answer_again(lab, pool):
    drive = gentle(seed=10)
    asked = pool.submit(lab.play, "broken.i02", drive)
    lab.waits()
    lab.end(kill=True)
    with pytest.raises(FaultError):
        asked.result(WAIT)
    lab.start()
    with Controller(lab.map).running() as controller:
        first = lab.play("resumed.i02", drive)
        # The campaign that asked was killed before it stored the answer.
        assert lab.play("resumed.i02-2", drive).response == first.response
        assert controller.played == ["broken.i02"]


def test_after_a_restart_a_name_is_answered_again_for_its_own_drive_only(lab):
    drive = gentle(seed=8)
    with Controller(lab.map).running() as controller:
        first = lab.play("same", drive)
        lab.end(kill=True)
        lab.start()
        assert lab.play("same", drive).response == first.response
        lab.end(kill=True)
        lab.start()
        with pytest.raises(FaultError, match="give every playback its own name") as refused:
            lab.play("same", gentle(seed=9))
        assert refused.value.code_name == "ALREADY_EXISTS"
        assert controller.played == ["same"]


def test_a_commander_that_is_killed_leaves_the_wait_and_latches_nothing(lab):
    drive = gentle(seed=3)
    (lab.folder / "request").write_bytes(lab.request("gone", drive).SerializeToString())
    script = (
        "import sys\nfrom pathlib import Path\nfrom duralab_bus import BusConfig, open_bus\n"
        "from duralab_proto.v1 import rig_pb2\n"
        "bus = open_bus(BusConfig(connect=(sys.argv[1],)), service='client')\n"
        "bus.wait_for_live({('rig_sim', 'beam')}, 60.0)\n"
        "request = rig_pb2.PlayRequest.FromString(Path(sys.argv[2]).read_bytes())\n"
        "bus.query(bus.keys.rig_play('beam'), request, rig_pb2.PlayResult)\n"
    )
    asked = [sys.executable, "-c", script, lab.bus.listening[0], str(lab.folder / "request")]
    with subprocess.Popen(asked, stderr=subprocess.DEVNULL) as commander:
        lab.waits()
        commander.kill()
    assert until(lambda: state if not (state := lab.state()).run else None).mode == rig_pb2.RIG_MODE_IDLE
    with Controller(lab.map).running() as controller:
        close_to(lab.play("gone-2", drive), truth(drive))
        assert controller.played == ["gone"]


def test_a_person_refuses_the_run(lab, pool):
    asked = pool.submit(lab.play, "no", gentle(seed=4))
    lab.waits()
    (lab.inbox / "no.refuse.txt").write_text("the specimen is not clamped.")
    with pytest.raises(FaultError, match=r"was refused at the controller: the specimen is not clamped\.$") as refused:
        asked.result(WAIT)
    assert refused.value.code_name == "CANCELLED"
    until(lambda: lab.state().mode == rig_pb2.RIG_MODE_IDLE)
    assert list(lab.outbox.glob("*.json")) == []


def test_a_stop_ends_the_wait_and_latches(lab, pool):
    asked = pool.submit(lab.play, "stopped", gentle(seed=5))
    lab.waits()
    state = lab.stop("lunch")
    assert (state.mode, state.reason, state.run) == (rig_pb2.RIG_MODE_INTERLOCKED, "lunch", "")
    with pytest.raises(FaultError, match="was stopped while it waited") as stopped:
        asked.result(WAIT)
    assert stopped.value.code_name == "CANCELLED"
    assert [path.name for path in lab.outbox.iterdir()] == ["done"]
    lab.ask(lab.bus.keys.rig_reset, rig_pb2.ResetRequest())
    with Controller(lab.map).running() as controller:
        close_to(lab.play("next", gentle(seed=5)), truth(gentle(seed=5)))
        assert controller.played == ["next"]


def test_a_refused_file_stays_with_its_reason_and_a_better_one_is_taken(lab, pool):
    drive = gentle(seed=6)
    asked = pool.submit(lab.play, "worse", drive)
    lab.waits()
    (lab.inbox / "worse.rsp").write_bytes(b"nothing")
    reason = lab.inbox / "worse.rsp.refused.txt"
    until(reason.exists)
    until(lambda: "the one that is there was refused" in lab.state().reason)
    assert (lab.inbox / "worse.rsp").exists()
    with Controller(lab.map).running():
        close_to(asked.result(WAIT), truth(drive))


def test_a_level_that_is_crossed_latches(lab):
    drive = gentle(seed=7)
    drive[1] *= 3.0
    with Controller(lab.map).running(), pytest.raises(FaultError, match="load"):
        lab.play("large", drive)
    assert lab.state().mode == rig_pb2.RIG_MODE_INTERLOCKED


def test_what_cannot_be_written_latches_nothing(lab):
    (lab.outbox / "done").rmdir()
    lab.outbox.rmdir()
    lab.outbox.write_text("no folder")
    with pytest.raises(FaultError, match="it cannot be written") as refused:
        lab.play("full", gentle())
    assert refused.value.code_name == "FAILED_PRECONDITION"
    assert lab.state().mode == rig_pb2.RIG_MODE_IDLE


def test_a_second_gateway_on_the_folder_is_refused(lab):
    asked = [sys.executable, "-m", "file_rig", "--config", str(lab.config)]
    with subprocess.Popen(asked, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as second:
        assert second.wait(WAIT) == 2
        assert "another gateway uses this exchange folder" in second.stderr.read()
