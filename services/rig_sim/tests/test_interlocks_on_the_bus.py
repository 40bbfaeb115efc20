"""Every interlock on a real bus: what trips ramps the rig down along its ramp and latches it with the reason."""

import dataclasses
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

import labbus
import rig_sim.performance
from duralab_proto.arrays import from_array, from_record, to_record
from duralab_proto.v1 import rig_pb2
from rig_sim import load_rig, shipped_specimens
from rig_sim.faults import DriftingGain, NoisySensor, StuckSensor, SupplySag, ValveSaturation
from rig_sim.interlock import Interlock
from rig_sim.player import Playback, RigFaultError
from rig_sim.service import SERVICE, RigServer
from rig_sim.watchdogs import WatchdogLimits, set_up_watchdogs

RIG = "front_axle"
WAIT = 120.0
RAMP_SAMPLES = 600


def guarded(rig, **limits):
    """Return the rig with these watchdogs and no others."""
    dogs = set_up_watchdogs(
        WatchdogLimits(**limits),
        responses={channel.name: "N" for channel in rig.specimen.responses},
        drives={channel.name: channel.unit for channel in rig.specimen.drives},
        followed=rig.model.input_names,
        monitored=rig.model.output_names[len(rig.specimen.responses) :],
    )
    return dataclasses.replace(rig, watchdogs=dogs)


def wave(seconds, size=0.03, rows=6):
    time_ = np.arange(round(1000 * seconds)) / 1000.0
    return size * np.sin(2 * np.pi * 1.5 * time_) * np.minimum(time_, 1.0) * np.ones((rows, 1))


class Client:
    def __init__(self, bus):
        self.bus, self.blocks, self.arrived, self.states = bus, [], [], []
        self.changed = threading.Condition()
        bus.subscribe(bus.keys.rig_signal(RIG, "*"), rig_pb2.SignalBlock, self._on_block)
        bus.subscribe(bus.keys.rig_state(RIG), rig_pb2.RigState, self._on_state)
        self.told = bus.query(bus.keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)

    def _on_block(self, item):
        now = time.monotonic()
        with self.changed:
            self.blocks.append(item.message)
            self.arrived.append(now)
            self.changed.notify_all()

    def _on_state(self, item):
        with self.changed:
            self.states.append(item.message)
            self.changed.notify_all()

    def wait_for(self, condition):
        with self.changed:
            assert self.changed.wait_for(condition, WAIT)

    def play(self, run, drive, *, real_time=False, **options):
        record = to_record(self.told.drives, 1000.0, drive)
        request = rig_pb2.PlayRequest(run=run, drive=record, real_time=real_time, seed=1)
        return self.bus.query(self.bus.keys.rig_play(RIG), request, rig_pb2.PlayResult, **options)

    def fault(self, *arguments, **options):
        with pytest.raises(labbus.FaultError) as caught:
            self.play(*arguments, **options)
        return caught.value

    def ask(self, key, request):
        return self.bus.query(key, request, rig_pb2.RigState)

    def state(self):
        return self.ask(self.bus.keys.rig_state(RIG), rig_pb2.StateRequest())

    def stop(self, reason="enough"):
        return self.ask(self.bus.keys.rig_stop(RIG), rig_pb2.StopRequest(reason=reason))

    def reset(self):
        return self.ask(self.bus.keys.rig_reset(RIG), rig_pb2.ResetRequest())

    def drive_of(self, run):
        self.wait_for(lambda: any(block.run == run and block.last for block in self.blocks))
        return np.hstack([from_array(block.drive) for block in self.blocks if block.run == run])


@contextmanager
def served(rig):
    with labbus.open_bus(service=SERVICE) as server_bus:
        server = RigServer(server_bus, rig, labbus.SpoolSpace(2**26), spool_wait_seconds=1.0)
        server_bus.declare_live(SERVICE, RIG)
        with labbus.open_bus(labbus.BusConfig(connect=tuple(server_bus.listening)), service="client") as bus:
            bus.wait_for_live({(SERVICE, RIG)}, WAIT)
            client = Client(bus)
            client.server = server
            yield client
        server.close()


def readings(rig, drive):
    playback = rig.playback(drive, seed=1)
    blocks = list(playback.blocks())
    monitored = dict(zip(rig.model.output_names[6:], np.hstack([block.monitored for block in blocks]), strict=True))
    return playback.response, np.hstack([block.following_error for block in blocks]), monitored


def tripped_at(values, limit):
    return int(np.argmax(np.abs(values) > limit))


@pytest.mark.parametrize("what", ["force", "following error", "pressure", "noisy sensor"])
def test_a_watchdog_ramps_down_and_latches_with_value_limit_and_time(front_axle, what):
    drive, rig = wave(4.0), front_axle
    if what == "noisy sensor":
        rig = dataclasses.replace(
            rig, faults=(NoisySensor(kind="noisy_sensor", channel="left_lateral", rms=5e3, start=2.0),)
        )
    response, following, monitored = readings(rig, drive)
    match what:
        case "force" | "noisy sensor":
            values, name, source = response[1], "left_lateral", "response"
            # Of a healthy sensor the noise of 5 kN is beyond the limit, the signal is not.
            limit = 0.5 * np.abs(values).max() if what == "force" else 1.1 * np.abs(values[:2000]).max() + 5e3
            limits = {"responses": {name: limit}}
        case "following error":
            values, name, source = following[0], "left_vertical", "following error"
            limit = 0.5 * np.abs(values).max()
            limits = {"following_errors": {name: limit}}
        case "pressure":
            values, name, source = monitored["left_vertical.load_pressure"], "left_vertical.load_pressure", "monitored"
            limit = 0.5 * (values.max() + values[0])
            values = np.maximum(values, 0.0)
            limits = {"monitored": {name: {"maximum": limit}}}
    sample = tripped_at(values, limit)
    assert sample > 100
    with served(guarded(rig, **limits)) as client:
        fault = client.fault("watched", drive)
        assert (fault.code_name, fault.field) == ("FAILED_PRECONDITION", "drive.samples")
        state = client.state()
        assert state.mode == rig_pb2.RIG_MODE_INTERLOCKED
        assert state.reason.startswith(f"the {source}")
        assert f"of {name} was {values[sample]:.4g}" in state.reason
        assert f"at {sample / 1000.0:.3f} s" in state.reason
        assert state.reason in fault.message
        # It went on to the end of the block, then along the ramp to zero and stayed there.
        done = (sample // 100 + 1) * 100
        whole = client.drive_of("watched")
        np.testing.assert_array_equal(whole[:, :done], drive[:, :done])
        assert whole.shape[1] == done + RAMP_SAMPLES
        assert not whole[:, -100:].any()
        assert np.abs(np.diff(whole)).max() * 1000.0 <= np.abs(np.diff(drive)).max() * 1000.0 + np.pi * 0.03
        # Latched: it stays, everybody was told, nothing plays before a reset.
        assert client.fault("after", np.zeros((6, 100))).code_name == "FAILED_PRECONDITION"
        client.wait_for(lambda: client.states[-1].mode == rig_pb2.RIG_MODE_INTERLOCKED and not client.states[-1].run)
        assert client.states[-1].reason == state.reason
        assert client.reset().mode == rig_pb2.RIG_MODE_IDLE
        assert client.play("after", np.zeros((6, 100))).run == "after"


@pytest.fixture(scope="module")
def client(front_axle):
    with served(front_axle) as client:
        yield client


def test_a_supply_that_sags_trips_the_shipped_watchdog():
    sagged = load_rig(shipped_specimens()[RIG], faults=[SupplySag(kind="supply_sag", share=0.6)])
    with served(sagged) as client:
        assert "FAULTS INJECTED: supply sagged to 60 %" in client.told.specimen
        assert client.fault("sagged", wave(1.0)).code_name == "FAILED_PRECONDITION"
        reason = client.state().reason
        assert reason.startswith("the monitored value of supply.pressure was 1.68e+07")


def test_a_valve_that_hardly_opens_trips_the_following_error():
    tired = load_rig(
        shipped_specimens()[RIG],
        faults=[ValveSaturation(kind="valve_saturation", actuator_kind="vertical", opening=0.02)],
    )
    with served(tired) as client:
        assert "FAULTS INJECTED: valves of kind vertical open to 2 % only" in client.told.specimen
        left = wave(3.0, size=0.11) * np.eye(6)[:, :1]
        fault = client.fault("tired", left)
        assert (fault.code_name, fault.field) == ("FAILED_PRECONDITION", "drive.samples")
        assert client.state().reason.startswith("the following error of left_vertical was ")
        assert "its watchdog allows -0.1 to 0.1 m" in client.state().reason


@pytest.mark.parametrize(
    "broken",
    [
        StuckSensor(kind="stuck_sensor", channel="left_lateral", start=0.2),
        DriftingGain(kind="drifting_gain", channel="left_lateral", rate=5.0),
    ],
)
def test_a_sensor_that_lies_within_its_limits_is_played_on(front_axle, broken):
    """Sticking and drifting are what a campaign has to find out; no limit is passed."""
    drive = wave(0.5, size=0.004)
    healthy = front_axle.playback(drive, seed=1)
    for _ in healthy.blocks():
        pass
    with served(dataclasses.replace(front_axle, faults=(broken,))) as client:
        _, _, response = from_record(client.play("lies", drive).response)
        assert client.state().mode == rig_pb2.RIG_MODE_IDLE
    np.testing.assert_array_equal(np.delete(response, 1, axis=0), np.delete(healthy.response, 1, axis=0))
    if isinstance(broken, StuckSensor):
        assert np.unique(response[1, 200:]).size == 1
    else:
        gain = 1.0 + 5.0 * np.arange(500) / 1000.0
        np.testing.assert_allclose(response[1], gain * healthy.response[1], rtol=1e-12)


def test_the_shipped_watchdogs_let_a_drive_at_half_the_limits_pass(client):
    assert client.play("usual", wave(3.0)).blocks == 30


def test_a_commander_that_goes_latches_the_rig(client):
    gone = threading.Event()
    fault = client.fault(
        "alone", wave(60.0), real_time=True, cancel=gone, on_progress=lambda progress: progress.fraction and gone.set()
    )
    assert fault.code_name == "CANCELLED"
    client.wait_for(lambda: client.states[-1].mode == rig_pb2.RIG_MODE_INTERLOCKED and not client.states[-1].run)
    assert client.state().reason == "its commander is gone"
    assert not client.drive_of("alone")[:, -1].any()
    assert client.drive_of("alone").shape[1] < 60_000
    assert client.fault("next", np.zeros((6, 100))).code_name == "FAILED_PRECONDITION"
    client.reset()


def in_background(client, run, drive, *, real_time):
    thread = threading.Thread(target=lambda: client.fault(run, drive, real_time=real_time))
    thread.start()
    client.wait_for(lambda: sum(block.run == run for block in client.blocks) >= 5)
    return thread


@pytest.mark.parametrize("real_time", [True, False])
def test_a_stop_is_acted_on_within_50_ms_of_samples(client, front_axle, real_time, monkeypatch):
    """Whatever this machine does meanwhile: counted in samples played after the stop was heard."""
    looked = []
    watched = rig_sim.performance.first_trip

    def watching(*arguments, **options):
        looked.append((options["first_sample"], options["response"].shape[1]))
        if len(looked) == 8:
            # On the playback's own thread, while it is within a block.
            client.server.stop("enough")
        return watched(*arguments, **options)

    monkeypatch.setattr(rig_sim.performance, "first_trip", watching)
    drive = wave(20.0)
    run = f"stopped-{real_time}".lower()
    assert client.fault(run, drive, real_time=real_time).code_name == "CANCELLED"
    whole = client.drive_of(run)
    heard = looked[7][0] + looked[7][1]
    left = int(np.argmax((whole != drive[:, : whole.shape[1]]).any(axis=0)))
    # The block in which it came, and the one that was being played: paced, they are 20 ms long, and no block begins
    # before its time has come. At full speed a block of 100 samples takes a few ms.
    block = 20 if real_time else 100
    assert {size for _, size in looked} == {block}
    assert 0 <= left - heard <= block + 1
    assert not real_time or 2 * block / 1000.0 < 0.05
    client.reset()


def test_a_paced_playback_waits_for_its_time_before_every_slice(client, monkeypatch):
    """What makes samples milliseconds: after each slice it waits until the clock has come to its end."""
    waits = []
    real = rig_sim.performance._Clock.ahead

    def ahead(clock, block):
        seconds = real(clock, block)
        waits.append((block.end, time.monotonic() - clock._started + seconds))
        return seconds

    monkeypatch.setattr(rig_sim.performance._Clock, "ahead", ahead)
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
    assert (result.blocks, result.response.samples.shape) == (3, [6, 300])
    state = client.state()
    assert state.mode == rig_pb2.RIG_MODE_INTERLOCKED
    assert state.reason == "the piston of left_vertical met its end stop; lower the drive"
    client.reset()


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
    with pytest.raises(labbus.FaultError, match=r"again while its reset waited \(somebody is in the cell\)") as caught:
        client.reset()
    assert caught.value.code_name == "FAILED_PRECONDITION"
    assert client.state().mode == rig_pb2.RIG_MODE_INTERLOCKED
    assert client.reset().mode == rig_pb2.RIG_MODE_IDLE


def test_a_reset_on_the_way_down_clears_the_stop_it_was_asked_for(client):
    thread = in_background(client, "reset_early", wave(60.0), real_time=True)
    client.server.stop("enough")
    assert client.reset().mode == rig_pb2.RIG_MODE_IDLE
    thread.join(WAIT)


def test_a_paced_playback_has_the_same_bytes_and_blocks(client):
    drive = wave(0.75)
    first, second = client.play("fast", drive), client.play("paced", drive, real_time=True)
    assert first.response.samples.data == second.response.samples.data
    assert first.blocks == second.blocks == 8
    assert [b.response.shape[1] for b in client.blocks if b.run == "paced"] == [100] * 7 + [50]
