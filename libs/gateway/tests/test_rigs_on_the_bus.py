"""A rig of four methods on a real bus: what it is given, what is published, and how it stops, fails and is reset."""

import threading

import numpy as np
import pytest
from rigs import WAIT, Springs, client_of, hump

from duralab_bus import FaultError
from duralab_gateway import Phase, RigFaultError, serve
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import rig_pb2


def channel_names(channels):
    return [channel.name for channel in channels]


def test_a_drive_is_played_in_pieces_and_published_as_it_was_answered():
    rig, drive = Springs(block_samples=30), hump(100)
    with client_of(rig) as client:
        assert client.told.block_samples == 30
        response = client.play("a", drive)
        np.testing.assert_array_equal(response, 1.0e4 * drive)
        published = client.published("a")
    np.testing.assert_array_equal(published[0], drive)
    np.testing.assert_array_equal(published[1], response)
    assert published[2] == [30, 30, 30, 10]
    assert [piece.shape for piece in rig.pieces] == [(2, 30), (2, 30), (2, 30), (2, 10)]
    assert set(rig.phases) == {Phase.PLAYING}


def test_the_way_in_and_the_way_down_are_continuous_and_no_part_of_the_stream():
    rig, drive = Springs(block_samples=10), np.full((2, 40), 0.05)
    with client_of(rig) as client:
        client.play("a", drive)
        np.testing.assert_array_equal(client.published("a")[0], drive)
    whole = np.hstack(rig.pieces)
    assert rig.phases == sorted(rig.phases, key=list(Phase).index)
    assert set(rig.phases) == set(Phase)
    assert whole[0, 0] == whole[0, -1] == 0.0
    # A raised cosine of 5 cm in 0.1 s is no faster than pi h / (2 T).
    assert np.abs(np.diff(whole)).max() * 200.0 <= np.pi * 0.05 / (2 * 0.1)


def test_what_a_description_leaves_out_follows_from_the_rest():
    with client_of(Springs()) as client:
        assert client.told.block_samples == 20
        np.testing.assert_array_equal(from_array(client.told.static_response), np.zeros(2))
        assert len(client.told.content_hash) == 64
    with client_of(Springs(version="2")) as other:
        assert other.told.content_hash != client.told.content_hash


class Waiting(Springs):
    """Plays until it is stopped; it says that it waits."""

    def __init__(self, **described):
        super().__init__(**described)
        self.moving, self.may_end = threading.Event(), threading.Event()

    def play(self, commands, run):
        self.pieces.append(commands)
        self.phases.append(run.phase)
        if run.phase is Phase.PLAYING:
            run.report("waiting for the operator to press start")
            run.report("half of it", 0.5)
            self.moving.set()
            while not (run.stopped or self.may_end.wait(0.01)):
                pass
        samples = commands.shape[1] // 2 if run.stopped else commands.shape[1]
        return 1.0e4 * commands[:, :samples]


def in_background(client, run, drive, ended):
    def play():
        try:
            ended.append(client.play(run, drive))
        except FaultError as fault:
            ended.append(fault)

    thread = threading.Thread(target=play)
    thread.start()
    return thread


def test_a_stop_ends_a_piece_that_waits_and_the_way_down_is_published():
    rig, ended = Waiting(publishes_after_run=True), []
    with client_of(rig) as client:
        thread = in_background(client, "a", hump(100), ended)
        assert rig.moving.wait(WAIT)
        state = client.stop("enough")
        thread.join(WAIT)
        assert (state.mode, state.reason, state.run) == (rig_pb2.RIG_MODE_INTERLOCKED, "enough", "")
        assert ended[0].code_name == "CANCELLED"
        assert str(ended[0]) == "run 'a' was stopped: enough."
        assert rig.stops == ["enough"]
        drive, response, sizes = client.published("a")
        np.testing.assert_array_equal(drive[:, :50], hump(100)[:, :50])
        assert np.abs(np.diff(drive)).max() < 0.005
        assert (drive[:, -1] == 0.0).all()
        np.testing.assert_array_equal(response, 1.0e4 * drive)
        assert max(sizes) <= 20
        assert "is interlocked (enough)" in str(client.fault("b", hump()))
        assert client.reset().mode == rig_pb2.RIG_MODE_IDLE
        assert rig.resets == 1


def test_a_rig_that_measures_at_the_end_gets_each_leg_in_one_piece():
    rig, drive = Springs(publishes_after_run=True), np.full((2, 90), 0.02)
    with client_of(rig) as client:
        client.play("a", drive)
        assert client.published("a")[2] == [20, 20, 20, 20, 10]
    assert rig.phases == list(Phase)
    assert rig.pieces[1].shape == (2, 90)


def test_a_rig_that_cannot_be_stopped_goes_on_and_answers():
    rig, ended = Waiting(publishes_after_run=True, cannot_be_stopped=True), []
    with client_of(rig) as client:
        thread = in_background(client, "a", hump(100), ended)
        assert rig.moving.wait(WAIT)
        state = client.stop("enough")
        assert (state.mode, state.run) == (rig_pb2.RIG_MODE_INTERLOCKED, "a")
        rig.may_end.set()
        thread.join(WAIT)
        np.testing.assert_array_equal(ended[0], 1.0e4 * hump(100))
        assert rig.stops == []
        assert client.state().reason == "enough"
        assert client.reset().mode == rig_pb2.RIG_MODE_IDLE


def test_a_watchdog_of_the_description_stops_the_run_with_its_sentence():
    watched = Springs().describe().responses
    watched[1].watchdog = 400.0
    rig = Springs()
    rig.describe = lambda: _with(Springs().describe(), watched)
    with client_of(rig) as client:
        fault = client.fault("a", hump(100))
        assert fault.code_name == "FAILED_PRECONDITION"
        assert "the response of b_force was" in str(fault)
        assert "its watchdog allows -400 to 400 N" in str(fault)
        assert client.state().mode == rig_pb2.RIG_MODE_INTERLOCKED
        assert len(rig.stops) == 1


def _with(told, responses):
    del told.responses[:]
    told.responses.extend(responses)
    return told


def test_words_of_the_rig_reach_the_commander():
    rig, told = Waiting(), []
    rig.may_end.set()
    with client_of(rig) as client:
        client.play("a", hump(), on_progress=lambda p: told.append((p.phase, p.detail, p.fraction)))
    assert ("waiting for the operator to press start", "a", 0.0) in told
    assert ("half of it", "a", 0.5) in told


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (lambda c: np.zeros((3, c.shape[1])), "the rig measured an array of shape (3, 20) at 0.000 s; (2, 20) was"),
        (lambda c: np.zeros((2, c.shape[1] + 1)), "the rig measured an array of shape (2, 21)"),
        (lambda c: c[:, 1:], "the rig measured 19 of 20 samples at 0.000 s, and it was not stopped."),
        (lambda c: np.where(c == c[0, 3], np.nan, c), "the response of a_force is nan at 0.015 s; every value must"),
    ],
    ids=["rows", "too_long", "too_short", "nan"],
)
def test_a_measurement_that_cannot_be_latches_the_rig_with_a_sentence(answer, sentence):
    rig = Springs()
    rig.play = lambda commands, _run: answer(commands)
    with client_of(rig) as client:
        fault = client.fault("a", hump())
        assert fault.code_name == "FAILED_PRECONDITION"
        assert sentence in str(fault)
        assert sentence.rstrip(".") in client.state().reason
        client.reset()


def test_a_rig_that_fails_and_may_not_be_reset_says_why_each_time():
    rig = Springs()

    def fail(*_):
        raise RigFaultError("the pressure was lost at valve 3; see to the pump.")

    def refuse():
        raise RigFaultError("the door of the cell is open; close it.")

    rig.play, rig.reset = fail, refuse
    with client_of(rig) as client:
        fault = client.fault("a", hump())
        assert (fault.code_name, str(fault)) == (
            "FAILED_PRECONDITION",
            "the pressure was lost at valve 3; see to the pump.",
        )
        with pytest.raises(FaultError, match=r"^springs cannot be reset: the door of the cell is open; close it\.$"):
            client.reset()
        assert client.state().mode == rig_pb2.RIG_MODE_INTERLOCKED
        rig.reset = lambda: None
        assert client.reset().mode == rig_pb2.RIG_MODE_IDLE


def test_the_name_and_the_reason_of_a_reset_stand_in_the_state_until_the_next_latch():
    with client_of(Springs()) as client:
        client.stop("oil on the floor")
        state = client.reset(name="Ada", reason="the floor is dry")
        assert (state.mode, state.reset_name, state.reset_reason) == (rig_pb2.RIG_MODE_IDLE, "Ada", "the floor is dry")
        # Of a rig that is not latched nothing is reset.
        client.reset(name="Grace", reason="to be sure")
        client.play("a", hump())
        assert (client.state().reset_name, client.state().reset_reason) == ("Ada", "the floor is dry")
        state = client.stop("again")
        assert (state.reset_name, state.reset_reason) == ("", "")
        assert client.reset().reset_reason == ""


@pytest.mark.parametrize(
    ("said", "field", "sentence"),
    [
        ({"reason": "x" * 301}, "reason", "reason has 301 characters; give at most 300."),
        ({"name": "x" * 81}, "name", "name has 81 characters; give at most 80."),
        ({"reason": "a\x07"}, "reason", r"reason is 'a\x07'; give printable characters on one line, not only blanks."),
        ({"reason": "a\nb"}, "reason", r"reason is 'a\nb'; give printable characters on one line, not only blanks."),
        ({"name": " "}, "name", "name is ' '; give printable characters on one line, not only blanks."),
    ],
)
def test_a_reset_that_says_what_cannot_be_shown_is_refused_and_clears_nothing(said, field, sentence):
    with client_of(Springs()) as client:
        client.stop("oil on the floor")
        with pytest.raises(FaultError) as caught:
            client.reset(command="once", **said)
        assert (caught.value.code_name, caught.value.field, str(caught.value)) == ("INVALID_ARGUMENT", field, sentence)
        assert client.state().mode == rig_pb2.RIG_MODE_INTERLOCKED
        assert client.reset(command="once", name="x" * 80, reason="x" * 300).mode == rig_pb2.RIG_MODE_IDLE


def test_a_rig_that_fails_to_stop_is_latched_and_answers_all_the_same():
    rig = Springs()

    def stop(_reason):
        raise OSError("no route to the controller")

    rig.stop = stop
    with client_of(rig) as client:
        assert client.stop("enough").mode == rig_pb2.RIG_MODE_INTERLOCKED
        client.reset()


def test_a_stop_while_the_rig_is_made_ready_keeps_it_latched_and_tells_it_again():
    rig = Springs()
    with client_of(rig) as client:
        client.stop("first")
        rig.reset = lambda: client.stop("somebody is in the cell")
        with pytest.raises(FaultError, match=r"again while its reset waited \(somebody is in the cell\)"):
            client.reset()
        assert client.state().reason == "first"
        assert rig.stops == ["first", "somebody is in the cell", "first"]


def test_poses_of_a_rig_that_knows_its_bodies_are_published():
    rig, seen = Springs(bodies=["beam"], rest_poses=to_array(np.zeros((1, 7)))), []
    rig.frames = lambda: np.array([[1.0, 0, 0, 0, 1, 0, 0, 0, 1, 0.1, 0.2, 0.3]])
    arrived = threading.Event()

    def take(item):
        seen.append(item.message)
        arrived.set()

    with client_of(rig) as client:
        client.bus.subscribe(client.bus.keys.rig_pose("springs"), rig_pb2.PoseBlock, take)
        client.play("a", hump(100))
        assert arrived.wait(WAIT)
    poses = from_array(seen[0].poses)
    np.testing.assert_array_equal(poses[0, 0], [0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0])


def test_a_process_without_a_rig_is_refused():
    with pytest.raises(ValueError, match=r"serve\(\) has no rig; give it one or more\."):
        serve()
