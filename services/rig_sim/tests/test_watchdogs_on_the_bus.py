"""Every watchdog on a real bus: what trips ramps the rig down along its ramp and latches it with the reason."""

import dataclasses
import threading

import numpy as np
import pytest
from served_rig import RIG, served, wave

from duralab_proto.arrays import from_record
from duralab_proto.v1 import rig_pb2
from rig_sim import load_rig, shipped_specimens
from rig_sim.playing.faults import DriftingGain, NoisySensor, StuckSensor, SupplySag, ValveSaturation
from rig_sim.specimen.specimen import WatchdogLimits, set_up_watchdogs

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


def readings(rig, drive):
    playback = rig.playback(drive, seed=1)
    blocks = list(playback.blocks())
    monitored = dict(zip(rig.model.output_names[6:], np.hstack([block.monitored for block in blocks]), strict=True))
    return playback.response, np.hstack([block.following_error for block in blocks]), monitored


def tripped_at(values, limit):
    return int(np.argmax(np.abs(values) > limit))


@pytest.mark.parametrize("what", ["force", "following error", "pressure", "noisy sensor"])
def test_a_watchdog_ramps_down_and_latches_with_value_limit_and_time(front_axle_compliant, what):
    drive, rig = wave(4.0), front_axle_compliant
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
def client(front_axle_compliant):
    with served(front_axle_compliant) as client:
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
def test_a_sensor_that_lies_within_its_limits_is_played_on(front_axle_compliant, broken):
    """Sticking and drifting are what a campaign has to find out; no limit is passed."""
    drive = wave(0.5, size=0.004)
    healthy = front_axle_compliant.playback(drive, seed=1)
    for _ in healthy.blocks():
        pass
    with served(dataclasses.replace(front_axle_compliant, faults=(broken,))) as client:
        _, _, response = from_record(client.play("lies", drive).response)
        assert client.state().mode == rig_pb2.RIG_MODE_IDLE
    np.testing.assert_array_equal(np.delete(response, 1, axis=0), np.delete(healthy.response, 1, axis=0))
    if isinstance(broken, StuckSensor):
        assert np.unique(response[1, 200:]).size == 1
    else:
        gain = 1.0 + 5.0 * np.arange(500) / 1000.0
        np.testing.assert_allclose(response[1], gain * healthy.response[1], rtol=1e-12)


def test_the_shipped_watchdogs_let_a_drive_at_half_the_limits_pass(client):
    assert client.play("usual", wave(3.0)).response.samples.shape == [6, 3000]


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
