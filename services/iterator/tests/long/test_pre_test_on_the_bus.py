"""Pre-tests of a rig in a process of its own: kept as recordings, compared with one another, demanded by campaigns."""

import threading
import time

import numpy as np
import pytest

from duralab_bus import BusConfig, FaultError, open_bus
from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator.limits import DriveLimits
from iterator.pre_test.pulses import pulse_train

from ..fake_lab import Identifier, Lab, Recorder
from ..linear_rig import specification
from ..rig_process import known_rig
from .test_service_on_the_bus import NOISE, RIG_PROCESS, process

LAB = "pre_test_test"
# Seconds of a playback.
RIGS = {"front": 0.0, "worn": 0.0, "demanded": 0.0, "inverted": 0.0, "slow": 3.0, "held": 3.0}
PASSED, FAILED = iterator_pb2.PRE_TEST_VERDICT_PASSED, iterator_pb2.PRE_TEST_VERDICT_FAILED
STEPS = ["PreTestRequest", "RigDescription", "RunPlanned", "PreTest", "RunPlayed", "RecordingClosed"]
HOUR = 3600 * 10**9


class PreTestLab(Lab):
    def pre_test(self, id, *, rig="front", **options):
        settings = {name: options.pop(name) for name in ("level", "seed", "real_time") if name in options}
        request = iterator_pb2.PreTestRequest(id=id, rig=rig, **settings)
        key = options.pop("key", self.bus.keys.pre_test(rig))
        return self.bus.query(key, request, iterator_pb2.PreTest, **options)

    def fault(self, id, **options):
        with pytest.raises(FaultError) as caught:
            self.pre_test(id, **options)
        return caught.value


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    with open_bus(BusConfig(lab=LAB), service="test") as hub:
        joined = BusConfig(lab=LAB, connect=hub.listening)
        with (
            open_bus(joined, service="recorder") as recorder,
            open_bus(joined, service="identifier") as identifier,
            process(hub, folder, "-m", "iterator", lab=LAB),
            process(hub, folder, str(RIG_PROCESS), lab=LAB, rigs=RIGS, noise_rms=NOISE),
        ):
            lab = PreTestLab(hub, Recorder(recorder), Identifier(identifier))
            wanted = {("iterator", "main"), *(("rig_sim", rig) for rig in RIGS)}
            hub.wait_for_live(wanted | {("recorder", "main"), ("identifier", "main")}, 120.0)
            yield lab


def test_a_pre_test_is_kept_as_a_recording_and_the_next_is_compared_with_it(lab):
    shown = []
    found = lab.pre_test("one", seed=4, on_progress=lambda message: shown.append(message.phase))
    assert (found.id, found.rig, found.verdict) == ("one", "front", PASSED)
    assert list(found.findings) == []
    assert "checking" in shown
    assert lab.recorder.kinds("one") == STEPS
    assert lab.recorder.read("one", iterator_pb2.PreTest) == [found]
    assert lab.recorder.read("one", recorder_pb2.RunPlanned)[0].run == found.run == "one.pulses"
    played = lab.recorder.read("one", recorder_pb2.RunPlayed)[0]
    assert (played.epoch, played.blocks) == (found.signal_epoch, found.signal_blocks)
    assert lab.recorder.read("one", recorder_pb2.RecordingClosed)[0].reason == "the pre-test passed"
    polarity, order = found.expectations
    assert polarity.startswith(
        "The polarity of left_vertical, right_vertical is not checked: the sensor table does not"
    )
    assert order.startswith("Whether left_vertical, right_vertical are swapped with others is not checked")
    # 5 % of 0.5 m, and of 100 m/s over a pulse of 0.2 s, which is more.
    np.testing.assert_allclose(from_array(found.amplitude), [0.025, 0.025])
    response = from_array(found.response)
    assert response.dtype == np.float32
    again = lab.pre_test("two", seed=5, level=0.02)
    np.testing.assert_allclose(from_array(again.amplitude), [0.01, 0.01])
    assert list(again.expectations) == ["Polarity, order, lag and gain are compared with the pre-test 'one'."]
    assert again.verdict == PASSED
    np.testing.assert_allclose(from_array(again.gain), 1.0, rtol=1e-3)


def test_the_drive_that_is_played_is_within_five_per_cent(lab):
    found = lab.pre_test("gentle", seed=6)
    limits = DriveLimits(
        ("l", "r"), ("m", "m"), np.full(2, -0.5), np.full(2, 0.5), np.full(2, 100.0), found.sample_rate
    )
    train = pulse_train(limits, sample_rate=found.sample_rate, level=0.05)
    assert np.abs(train.drive).max() <= 0.025 + 1e-12
    # What was measured is the response to these pulses, and to nothing else.
    expected = known_rig(noise_rms=NOISE).respond(train.drive, seed=6)
    expected -= expected[:, : train.rest].mean(axis=1)[:, None]
    np.testing.assert_allclose(from_array(found.response), expected, atol=1e-6 * np.abs(expected).max())


def test_an_overdue_calibration_is_said_before_anything_moves_and_is_no_failure(lab):
    shown = []
    found = lab.pre_test(
        "worn-one", rig="worn", on_progress=lambda message: shown.append((message.phase, message.detail))
    )
    overdue = "The calibration of left_vertical (LC-1) is overdue since 2020-02-29"
    first = next(index for index, (_, detail) in enumerate(shown) if detail.startswith(overdue))
    assert all(phase == "checking" for phase, _ in shown[: first + 1])
    assert found.verdict == PASSED
    assert found.findings[0].check == iterator_pb2.PRE_TEST_CHECK_CALIBRATION
    assert found.findings[0].sentence.startswith(overdue)


def test_a_pre_test_that_does_not_pass_says_what_is_wrong(lab):
    found = lab.pre_test("wrong", rig="inverted")
    assert found.verdict == FAILED
    (finding,) = found.findings
    assert (finding.check, list(finding.channels)) == (iterator_pb2.PRE_TEST_CHECK_POLARITY, ["right_vertical"])
    assert finding.failed
    assert lab.recorder.read("wrong", recorder_pb2.RecordingClosed)[0].reason == "the pre-test failed"
    # One that did not pass is nothing to compare with.
    assert all("compared with the pre-test" not in said for said in lab.pre_test("again", rig="inverted").expectations)


def test_a_campaign_demands_a_pre_test_that_passed_is_new_and_of_the_same_rig(lab):
    def start(id, hours):
        spec = specification(id, rig="demanded", iterations=1)
        spec.pre_test = hours
        return lab.start(spec)

    def refused(id, hours, code=query_pb2.FAULT_CODE_FAILED_PRECONDITION):
        with pytest.raises(FaultError) as caught:
            start(id, hours)
        assert (caught.value.code, caught.value.field) == (code, "pre_test")
        return str(caught.value)

    demand = "The campaign demands a pre-test of demanded that passed within the last 2 hours"
    assert refused("c1", 2.0) == f"{demand}, and there is none; run `duralab pre-test demanded`."
    assert "pre_test is -1" in refused("c1", -1.0, query_pb2.FAULT_CODE_INVALID_ARGUMENT)
    lab.pre_test("p1", rig="demanded")
    lab.recorder.begun["p1"] = time.time_ns() - 3 * HOUR
    assert refused("c1", 2.0) == f"{demand}, and the newest, 'p1', is 3.0 hours old; run `duralab pre-test demanded`."
    started = start("c1", 4.0)
    assert any(remark.startswith("The pre-test 'p1' of demanded passed 3.0 hours before") for remark in started.remarks)
    assert lab.end_of("c1").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert lab.recorder.read("c1", iterator_pb2.CampaignSpec)[0].pre_test == 4.0
    steps, older = lab.recorder.steps["p1"], lab.recorder.read("p1", iterator_pb2.PreTest)[0]
    for change, sentence in (
        ({"rig_content_hash": "other"}, "and the rig was changed since the newest, 'p1'; run"),
        ({"verdict": FAILED}, "and the newest, 'p1', did not pass; see to its findings and run"),
    ):
        changed = iterator_pb2.PreTest()
        changed.CopyFrom(older)
        for name, value in change.items():
            setattr(changed, name, value)
        steps[STEPS.index("PreTest")] = ("PreTest", changed.SerializeToString())
        assert sentence in refused("c2", 4.0)
    # One that was stopped says nothing: the one before it counts.
    steps[STEPS.index("PreTest")] = ("PreTest", older.SerializeToString())
    lab.recorder.steps["p2"] = [step for step in steps if step[0] in ("PreTestRequest", "RecordingClosed")]
    assert start("c3", 4.0).id == "c3"
    lab.end_of("c3")


def test_a_client_that_gives_up_stops_the_rig_and_the_recording_is_closed(lab):
    given_up, playing = threading.Event(), threading.Event()

    def follow(message):
        if message.phase not in ("", "checking"):
            playing.set()
            given_up.set()

    fault = lab.fault("stopped", rig="slow", cancel=given_up, on_progress=follow)
    assert playing.is_set()
    assert fault.code == query_pb2.FAULT_CODE_CANCELLED
    until = time.monotonic() + 30.0
    while lab.rig_state("slow").mode != rig_pb2.RIG_MODE_INTERLOCKED or "stopped" not in lab.recorder.steps:
        assert time.monotonic() < until
        time.sleep(0.05)
    while lab.recorder.kinds("stopped")[-1] != "RecordingClosed":
        assert time.monotonic() < until
        time.sleep(0.05)
    assert "PreTest" not in lab.recorder.kinds("stopped")
    assert lab.recorder.read("stopped", recorder_pb2.RecordingClosed)[0].reason.startswith(
        "the pre-test was broken off: "
    )
    # The rig is free a moment after its recording is closed.
    while (refused := lab.fault("latched", rig="slow")).code == query_pb2.FAULT_CODE_BUSY:
        assert time.monotonic() < until
        time.sleep(0.05)
    assert "interlocked" in str(refused)
    lab.reset("slow")


def test_a_rig_is_used_by_one_pre_test_or_campaign_at_a_time(lab):
    playing, ended = threading.Event(), []

    def follow(message):
        if message.phase not in ("", "checking"):
            playing.set()

    thread = threading.Thread(target=lambda: ended.append(lab.pre_test("long", rig="held", on_progress=follow)))
    thread.start()
    try:
        assert playing.wait(30.0)
        with pytest.raises(FaultError, match="Rig 'held' is in use by pre-test 'long'; wait for its end") as caught:
            lab.start(specification("other", rig="held"))
        assert caught.value.code == query_pb2.FAULT_CODE_BUSY
        assert lab.fault("third", rig="held").code == query_pb2.FAULT_CODE_BUSY
    finally:
        thread.join(60.0)
    assert ended[0].verdict == PASSED


def test_what_a_crash_left_open_is_closed_by_the_next_pre_test(lab):
    request = iterator_pb2.PreTestRequest(id="left", rig="front")
    lab.recorder.steps["left"] = [("PreTestRequest", request.SerializeToString())]
    lab.pre_test("next")
    assert lab.recorder.kinds("left") == ["PreTestRequest", "RecordingClosed"]


@pytest.mark.parametrize(
    ("request_", "code", "field", "sentence"),
    [
        (
            {"level": 0.06},
            query_pb2.FAULT_CODE_INVALID_ARGUMENT,
            "level",
            "level is 0.06; a pre-test uses above 0 to 0.05",
        ),
        ({"level": -0.01}, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "level", "level is -0.01"),
        ({"level": float("nan")}, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "level", "level is nan"),
        ({"rig": "nobody"}, query_pb2.FAULT_CODE_NOT_FOUND, "rig", ""),
        ({"key": "slow"}, query_pb2.FAULT_CODE_INVALID_ARGUMENT, "rig", "is that of rig 'slow'"),
    ],
)
def test_a_request_that_cannot_be_is_refused_and_nothing_is_stored(lab, request_, code, field, sentence):
    if "key" in request_:
        request_ = {"key": lab.bus.keys.pre_test(request_["key"])}
    fault = lab.fault("refused", **request_)
    assert (fault.code, fault.field) == (code, field)
    assert sentence in str(fault)
    assert "refused" not in lab.recorder.steps


def test_an_id_is_used_once(lab):
    lab.pre_test("once")
    assert lab.fault("once").code == query_pb2.FAULT_CODE_ALREADY_EXISTS
    assert lab.recorder.kinds("once") == STEPS
