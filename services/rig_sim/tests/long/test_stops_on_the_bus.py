"""Stops, resets and states on a real bus: what moves the rig, what latches it, and what clears the latch."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from served_rig import WAIT, served, wave

import duralab_bus
import duralab_gateway.playback_session
import duralab_gateway.publishing
from duralab_gateway.interlock import Interlock
from duralab_gateway.motion import Block, RigFaultError
from duralab_proto.arrays import from_array
from duralab_proto.v1 import rig_pb2
from rig_sim.playing.player import Playback


@pytest.fixture(scope="module")
def client(front_axle_compliant):
    with served(front_axle_compliant) as client:
        yield client


def in_background(client, run, drive, *, real_time):
    thread = threading.Thread(target=lambda: client.fault(run, drive, real_time=real_time))
    thread.start()
    client.wait_for(lambda: sum(block.run == run for block in client.blocks) >= 5)
    return thread


@pytest.mark.parametrize("real_time", [True, False])
def test_a_stop_is_acted_on_within_50_ms_of_samples(client, front_axle_compliant, real_time, monkeypatch):
    """Whatever this machine does meanwhile: counted in samples played after the stop was heard."""
    looked = []
    watched = duralab_gateway.playback_session.WatchdogMonitor.first_trip

    def watching(monitor, block):
        looked.append((block.first_sample, block.response.shape[1]))
        if len(looked) == 8:
            # On the playback's own thread, while it is within a block.
            client.server.stop("enough")
        return watched(monitor, block)

    monkeypatch.setattr(duralab_gateway.playback_session.WatchdogMonitor, "first_trip", watching)
    drive = wave(20.0)
    run = f"stopped-{real_time}".lower()
    assert client.fault(run, drive, real_time=real_time).code_name == "CANCELLED"
    whole = client.drive_of(run)
    heard = looked[7][0] + looked[7][1]
    left = int(np.argmax((whole != drive[:, : whole.shape[1]]).any(axis=0)))
    # The block in which it came, and the one that was being played: paced, they are 20 ms long, and no block begins
    # before its time has come. At full speed 600 samples take a few ms.
    block = 20 if real_time else 600
    assert {size for _, size in looked} == {block}
    assert 0 <= left - heard <= block + 1
    assert not real_time or 2 * block / 1000.0 < 0.05
    client.reset()


def test_a_paced_playback_waits_for_its_time_before_every_slice(client, monkeypatch):
    """What makes samples milliseconds: after each slice it waits until the clock has come to its end."""
    waits = []
    real = duralab_gateway.publishing.Clock.ahead

    def ahead(clock, block):
        seconds = real(clock, block)
        waits.append((block.end, time.monotonic() - clock._started + seconds))
        return seconds

    monkeypatch.setattr(duralab_gateway.publishing.Clock, "ahead", ahead)
    client.play("waits", wave(0.5), real_time=True)
    # Those of the drive; the way back to zero keeps to the same clock.
    assert [end for end, _ in waits][:25] == list(range(20, 501, 20))
    assert all(until >= end / 1000.0 - 1e-3 for end, until in waits)


def test_a_stop_while_it_settles_ramps_down_from_there_and_publishes_nothing_of_the_run(client):
    stopping = threading.Thread(target=client.stop, args=("not yet",))

    def on_progress(progress):
        if progress.phase == "settling" and not stopping.ident:
            stopping.start()

    fault = client.fault("settles", wave(1.0) + 0.01, real_time=True, on_progress=on_progress)
    stopping.join(WAIT)
    assert (fault.code_name, "run 'settles' was stopped: not yet" in fault.message) == ("CANCELLED", True)
    assert not [block for block in client.blocks if block.run == "settles"]
    modes = [state.mode for state in client.states if state.run == "settles"]
    assert rig_pb2.RIG_MODE_PLAYING not in modes
    client.wait_for(lambda: client.states[-1].mode == rig_pb2.RIG_MODE_INTERLOCKED and not client.states[-1].run)
    client.reset()


def test_the_state_says_settling_playing_ramping_down_and_idle(client):
    before = len(client.states)
    drive = wave(0.3) + 0.01
    result = client.play("offset", drive)
    client.wait_for(lambda: len(client.states) > before and client.states[-1].mode == rig_pb2.RIG_MODE_IDLE)
    told = [(state.mode, state.run) for state in client.states[before:]]
    # A rig at rest says so again every second: that may come between the count above and the playback.
    beginning = next(place for place, (_, run) in enumerate(told) if run)
    assert list(dict.fromkeys(told[beginning:])) == [
        (rig_pb2.RIG_MODE_SETTLING, "offset"),
        (rig_pb2.RIG_MODE_PLAYING, "offset"),
        (rig_pb2.RIG_MODE_RAMPING_DOWN, "offset"),
        (rig_pb2.RIG_MODE_IDLE, ""),
    ]
    # The stream is the drive's own samples, no ramp.
    np.testing.assert_array_equal(client.drive_of("offset"), drive)
    assert result.response.samples.shape == [6, 300]


def test_a_rig_that_fails_on_its_way_to_rest_latches_and_answers_with_all_that_was_measured(client, monkeypatch):
    def ramp_down(_playback):
        yield from ()
        raise RigFaultError("the piston of left_vertical met its end stop; lower the drive.")

    monkeypatch.setattr(Playback, "ramp_down", ramp_down)
    result = client.play("fails_late", wave(0.3) + 0.01)
    assert (result.blocks, result.response.samples.shape) == (1, [6, 300])
    state = client.state()
    assert state.mode == rig_pb2.RIG_MODE_INTERLOCKED
    assert state.reason == "the piston of left_vertical met its end stop; lower the drive"
    client.reset()


def fail_from_half_a_second(monkeypatch, error):
    advance = Playback._advance

    def failing(playback, commands, first, *, counted):
        # In whatever block that time lies: several blocks played at once are taken back.
        if first + commands.shape[1] - 1 > 500:
            raise error
        return advance(playback, commands, first, counted=counted)

    monkeypatch.setattr(Playback, "_advance", failing)


def test_a_rig_that_fails_within_its_drive_has_published_all_that_it_measured(client, monkeypatch):
    fail_from_half_a_second(
        monkeypatch, RigFaultError("the piston of left_vertical met its end stop; lower the drive.")
    )
    drive = wave(1.0)
    assert client.fault("fails_within", drive).code_name == "FAILED_PRECONDITION"
    client.wait_for(lambda: sum(block.drive.shape[1] for block in client.blocks if block.run == "fails_within") == 500)
    played = [from_array(block.drive) for block in client.blocks if block.run == "fails_within"]
    np.testing.assert_array_equal(np.hstack(played), drive[:, :500])
    client.reset()


def test_a_defect_within_a_drive_latches_the_rig(client, monkeypatch):
    fail_from_half_a_second(monkeypatch, TypeError("no such thing"))
    assert client.fault("defect", wave(1.0)).code_name == "INTERNAL"
    state = client.state()
    assert state.mode == rig_pb2.RIG_MODE_INTERLOCKED
    assert state.reason == "run 'defect' was broken off by a defect (TypeError: no such thing)"
    client.reset()


def test_the_time_that_a_playback_waits_for_room_is_none_of_its_clock(monkeypatch):
    now = 100.0
    monkeypatch.setattr(duralab_gateway.publishing, "time", SimpleNamespace(monotonic=lambda: now))
    clock = duralab_gateway.publishing.Clock(1000.0, real_time=True)
    now = 130.0
    empty = np.zeros((1, 20))
    first, second = (Block(at, empty, empty, empty, empty) for at in (0, 20))
    assert clock.ahead(first) == pytest.approx(0.02)
    assert clock.ahead(second) == pytest.approx(0.04)


def test_until_it_rests_an_interlocked_rig_has_a_run(client):
    thread = in_background(client, "goes_down", wave(60.0), real_time=True)
    state = client.stop()
    thread.join(WAIT)
    # Answered when it rests; on the way down everybody was told that it is latched, with the run that moves it.
    assert (state.mode, state.run) == (rig_pb2.RIG_MODE_INTERLOCKED, "")
    client.wait_for(lambda: client.states[-1].mode == rig_pb2.RIG_MODE_INTERLOCKED and not client.states[-1].run)
    latched = [
        state.run for state in client.states if state.mode == rig_pb2.RIG_MODE_INTERLOCKED and state.reason == "enough"
    ]
    assert latched[-2:] == ["goes_down", ""]
    assert client.reset().mode == rig_pb2.RIG_MODE_IDLE


def test_a_stop_while_a_reset_waits_for_the_rest_keeps_the_rig_latched(client, monkeypatch):
    client.stop("first")
    rest = Interlock.wait_for_rest

    def meanwhile(interlock):
        monkeypatch.undo()
        client.server.stop("somebody is in the cell")
        return rest(interlock)

    monkeypatch.setattr(Interlock, "wait_for_rest", meanwhile)
    with pytest.raises(
        duralab_bus.FaultError, match=r"again while its reset waited \(somebody is in the cell\)"
    ) as caught:
        client.reset()
    assert caught.value.code_name == "FAILED_PRECONDITION"
    assert client.state().mode == rig_pb2.RIG_MODE_INTERLOCKED
    assert client.reset().mode == rig_pb2.RIG_MODE_IDLE


def test_a_reset_on_the_way_down_clears_the_stop_it_was_asked_for(client):
    thread = in_background(client, "reset_early", wave(60.0), real_time=True)
    client.server.stop("enough")
    assert client.reset().mode == rig_pb2.RIG_MODE_IDLE
    thread.join(WAIT)


def test_a_paced_playback_has_the_same_bytes_in_blocks_of_a_tenth_of_a_second(client):
    drive = wave(0.75)
    first, second = client.play("fast", drive), client.play("paced", drive, real_time=True)
    assert first.response.samples.data == second.response.samples.data
    for told, run, sizes in ((first, "fast", [600, 150]), (second, "paced", [100] * 7 + [50])):
        np.testing.assert_array_equal(client.drive_of(run), drive)
        assert [block.response.shape[1] for block in client.blocks if block.run == run] == sizes
        assert told.blocks == len(sizes)


def test_a_rig_of_a_lab_in_real_time_paces_every_drive_and_answers_the_same_bytes(
    client, front_axle_compliant, monkeypatch
):
    drive = wave(0.75)
    fast = client.play("at-full-speed", drive)
    with served(front_axle_compliant, real_time=True) as paced:
        ends = []
        real = duralab_gateway.publishing.Clock.ahead

        def ahead(clock, block):
            seconds = real(clock, block)
            ends.append((block.end / 1000.0, time.monotonic() - clock._started + seconds))
            return seconds

        monkeypatch.setattr(duralab_gateway.publishing.Clock, "ahead", ahead)
        result = paced.play("asked-for-full-speed", drive)
        assert ends
        assert all(until >= end - 1e-3 for end, until in ends)
    assert result.response.samples.data == fast.response.samples.data
    assert result.real_time_factor <= 1.01


def test_a_stop_latches_a_rig_whatever_it_does(client, monkeypatch):
    def latched():
        state = client.stop("enough")
        assert (state.mode, state.run, state.reason) == (rig_pb2.RIG_MODE_INTERLOCKED, "", "enough")
        assert client.reset().mode == rig_pb2.RIG_MODE_IDLE

    latched()
    client.play("has-just-ended", wave(0.3))
    latched()

    def stop(mode, _enter=Interlock.enter):
        _enter(client.server._interlock, mode)
        if mode == rig_pb2.RIG_MODE_RAMPING_DOWN:
            client.server.stop("on its way down")

    monkeypatch.setattr(client.server._interlock, "enter", stop)
    # All of it was played: the drive is answered, and the rig latched.
    assert client.play("ramps-down", wave(0.3) + 0.01).response.samples.shape == [6, 300]
    assert client.state().reason == "on its way down"
    client.reset()
