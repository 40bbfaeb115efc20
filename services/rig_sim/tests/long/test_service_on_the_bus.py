"""The rig simulator as a process on a real bus: what is played, streamed, stopped, refused."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

import duralab_bus
from duralab_proto.arrays import from_array, from_record, to_record
from duralab_proto.v1 import rig_pb2
from rig_sim import shipped_specimens

HERE = Path(__file__).parents[1]
WAIT = 120.0
RIG = "front_axle_compliant"


def start(folder, config, **options):
    path = folder / "rig_sim.yaml"
    path.write_text(config if isinstance(config, str) else yaml.safe_dump(config))
    return subprocess.Popen([sys.executable, "-m", "rig_sim", "--config", str(path)], **options)


class Lab:
    """A client beside one process that serves both rigs; remembers every state and block."""

    def __init__(self, bus):
        self.bus = bus
        self.states = []
        self.blocks = []
        self.changed = threading.Condition()
        bus.subscribe(bus.keys.rig_state("*"), rig_pb2.RigState, self._on_state, repair=True)
        bus.subscribe(bus.keys.rig_signal("*", "*"), rig_pb2.SignalBlock, self._on_block, repair=True)
        self.description = bus.query(
            bus.keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription
        )

    def _on_state(self, item):
        with self.changed:
            self.states.append(item.message)
            self.changed.notify_all()

    def _on_block(self, item):
        with self.changed:
            self.blocks.append(item)
            self.changed.notify_all()

    def wait_for(self, condition):
        with self.changed:
            assert self.changed.wait_for(condition, WAIT)

    def last_state(self, run):
        """Return the modes seen since a run began."""
        runs = [state.run for state in self.states]
        return [state.mode for state in self.states[runs.index(run) :]] if run in runs else []

    def blocks_of(self, run):
        return [item for item in self.blocks if item.message.run == run]

    def state(self):
        return self.bus.query(self.bus.keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState)

    def play(self, run, drive, *, seed=0, real_time=False, **options):
        record = to_record(self.description.drives, 1000.0, drive)
        request = rig_pb2.PlayRequest(run=run, drive=record, seed=seed, real_time=real_time)
        return self.bus.query(self.bus.keys.rig_play(RIG), request, rig_pb2.PlayResult, **options)

    def refused(self, *arguments, **options):
        with pytest.raises(duralab_bus.FaultError) as caught:
            self.play(*arguments, **options)
        return caught.value

    def stop(self, reason="test"):
        return self.bus.query(self.bus.keys.rig_stop(RIG), rig_pb2.StopRequest(reason=reason), rig_pb2.RigState)

    def reset(self):
        return self.bus.query(self.bus.keys.rig_reset(RIG), rig_pb2.ResetRequest(), rig_pb2.RigState)

    def in_background(self, run, drive):
        """Play in real time on another thread; the list gets the fault or the result."""
        outcome = []

        def ask():
            try:
                outcome.append(self.play(run, drive, real_time=True))
            except duralab_bus.FaultError as fault:
                outcome.append(fault)

        thread = threading.Thread(target=ask)
        thread.start()
        self.wait_for(lambda: len(self.blocks_of(run)) >= 2)
        return thread, outcome


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    with duralab_bus.open_bus(service="client") as bus:
        config = {"rigs": [RIG, "predecessor"], "bus": {"connect": list(bus.listening)}}
        process = start(tmp_path_factory.mktemp("rig"), config)
        bus.wait_for_live({("rig_sim", "front_axle_compliant"), ("rig_sim", "predecessor")}, WAIT)
        yield Lab(bus)
        process.terminate()
        assert process.wait(WAIT) == 0


def wave(samples, amplitude=0.005):
    return amplitude * np.sin(2 * np.pi * 2.0 * np.arange(samples) / 1000.0) * np.ones((6, 1))


def test_description_tells_channels_limits_and_static_forces(lab, front_axle_compliant):
    told = lab.description
    assert [channel.name for channel in told.drives] == list(front_axle_compliant.model.input_names)
    assert [channel.name for channel in told.responses] == list(front_axle_compliant.model.response_names)
    assert {(channel.unit, channel.minimum < 0 < channel.maximum) for channel in told.drives} == {("m", True)}
    assert {channel.unit for channel in told.responses} == {"N"}
    assert (told.rig, told.engine, told.sample_rate, told.block_samples) == (RIG, "compiled", 1000.0, 600)
    np.testing.assert_array_equal(from_array(told.static_response), front_axle_compliant.static_response)
    assert told.content_hash == front_axle_compliant.content_hash


def test_stream_blocks_are_contiguous_and_equal_the_result(lab, front_axle_compliant):
    drive = wave(2345)
    result = lab.play("blocks", drive, seed=7)
    lab.wait_for(lambda: len(lab.blocks_of("blocks")) == result.blocks)
    items = lab.blocks_of("blocks")
    assert result.blocks == 4
    assert {item.epoch for item in items} == {result.epoch}
    assert [item.seq for item in items] == list(range(4))
    assert [item.message.first_sample for item in items] == list(range(0, 2345, 600))
    assert [item.message.last for item in items] == [False] * 3 + [True]
    _, rate, response = from_record(result.response)
    assert rate == 1000.0
    np.testing.assert_array_equal(np.hstack([from_array(item.message.response) for item in items]), response)
    np.testing.assert_array_equal(np.hstack([from_array(item.message.drive) for item in items]), drive)
    # What came over the bus are the bytes that a notebook gets.
    playback = front_axle_compliant.playback(drive, seed=7)
    for _ in playback.blocks():
        pass
    assert playback.response.tobytes() == response.tobytes()
    assert [use.drive for use in result.actuators] == list(front_axle_compliant.model.input_names)
    assert result.real_time_factor > 0.0
    assert lab.state() == rig_pb2.RigState(rig=RIG, mode=rig_pb2.RIG_MODE_IDLE)
    lab.wait_for(lambda: lab.last_state("blocks")[-1:] == [rig_pb2.RIG_MODE_IDLE])


def test_progress_goes_up_and_real_time_is_kept(lab):
    fractions = []
    began = time.monotonic()
    # Two whole periods but a sample: it ends a little away from zero, so the way back is told as well.
    lab.play("progress", wave(1000), real_time=True, on_progress=lambda progress: fractions.append(progress.fraction))
    # Not sooner; how much later is this machine's affair.
    assert time.monotonic() - began > 0.95
    assert len(fractions) >= 4
    assert fractions == sorted(fractions)
    assert 0.0 < fractions[0] < fractions[-1] <= 1.0


def test_a_rig_that_plays_is_busy_and_a_stop_ramps_it_down_and_latches_it(lab):
    thread, outcome = lab.in_background("stopped", wave(60_000))
    assert lab.state().mode == rig_pb2.RIG_MODE_PLAYING
    busy = lab.refused("other", wave(100))
    assert (busy.code_name, "plays run 'stopped'" in busy.message) == ("BUSY", True)
    state = lab.stop("somebody is in the cell")
    assert state == rig_pb2.RigState(rig=RIG, mode=rig_pb2.RIG_MODE_INTERLOCKED, reason="somebody is in the cell")
    thread.join(WAIT)
    (fault,) = outcome
    assert (fault.code_name, fault.message) == ("CANCELLED", "run 'stopped' was stopped: somebody is in the cell.")
    # The way down is part of the stream, without a gap, and ends at zero.
    lab.wait_for(lambda: lab.blocks_of("stopped")[-1].message.last)
    messages = [item.message for item in lab.blocks_of("stopped")]
    lengths = [message.drive.shape[1] for message in messages]
    assert [m.first_sample for m in messages] == [0, *np.cumsum(lengths)[:-1]]
    assert sum(lengths) < 60_000
    assert not from_array(messages[-1].drive)[:, -1].any()
    latched = lab.refused("after", wave(100))
    assert latched.code_name == "FAILED_PRECONDITION"
    assert latched.message == "front_axle_compliant is interlocked (somebody is in the cell); reset it before it plays."
    assert lab.reset() == rig_pb2.RigState(rig=RIG, mode=rig_pb2.RIG_MODE_IDLE)
    assert lab.play("after", wave(100)).run == "after"


def test_stop_and_reset_of_an_idle_rig(lab):
    assert lab.stop("").mode == rig_pb2.RIG_MODE_INTERLOCKED
    assert lab.stop("again").reason == "stopped on request"
    lab.wait_for(lambda: lab.states[-1].mode == rig_pb2.RIG_MODE_INTERLOCKED)
    assert lab.reset().mode == rig_pb2.RIG_MODE_IDLE
    assert lab.reset().mode == rig_pb2.RIG_MODE_IDLE
    lab.wait_for(lambda: lab.states[-1].mode == rig_pb2.RIG_MODE_IDLE)


def test_reset_of_a_rig_that_plays_changes_nothing(lab):
    thread, outcome = lab.in_background("goes_on", wave(800))
    assert lab.reset().mode == rig_pb2.RIG_MODE_PLAYING
    thread.join(WAIT)
    assert outcome[0].run == "goes_on"


def test_a_rig_whose_client_is_killed_ramps_down_and_is_latched(lab, tmp_path):
    process = subprocess.Popen([sys.executable, str(HERE / "asking_process.py"), lab.bus.listening[0], "orphan"])
    try:
        lab.wait_for(lambda: len(lab.blocks_of("orphan")) >= 2)
    finally:
        process.kill()
        process.wait()
    lab.wait_for(lambda: lab.last_state("orphan")[-1:] == [rig_pb2.RIG_MODE_INTERLOCKED])
    lab.wait_for(lambda: lab.blocks_of("orphan")[-1].message.last)
    last = lab.blocks_of("orphan")[-1].message
    assert not from_array(last.drive)[:, -1].any()
    assert last.first_sample < 59_000
    assert lab.refused("after_orphan", wave(100)).code_name == "FAILED_PRECONDITION"
    assert lab.state().reason == "its commander is gone"
    assert lab.reset().mode == rig_pb2.RIG_MODE_IDLE
    assert lab.play("after_orphan", wave(100)).run == "after_orphan"


def test_a_drive_at_all_limits_saturates_the_valve_and_leaves_the_rig_whole(lab):
    limits = lab.description.drives[0]
    step = 0.999 * limits.slew_limit / 1000.0
    wanted = limits.maximum * np.sign(np.sin(2 * np.pi * 5.0 * np.arange(1000) / 1000.0))
    drive = np.zeros((6, 1000))
    for sample in range(1, 1000):
        before = drive[0, sample - 1]
        drive[0, sample] = before + np.clip(wanted[sample] - before, -step, step)
    result = lab.play("hard", drive)
    (vertical, *others) = result.actuators
    assert vertical.peak_command_ratio > 0.95
    assert vertical.saturated_share > 0.3
    assert vertical.largest_following_error > 0.02
    assert max(use.peak_command_ratio for use in others) == 0.0
    assert lab.state().mode == rig_pb2.RIG_MODE_IDLE


@pytest.mark.parametrize(
    ("run", "change", "field", "said"),
    [
        ("Bad Name", {}, "run", "'Bad Name'"),
        ("short", {"rows": 5}, "drive.channels", "the drive has 5 channels"),
        ("renamed", {"name": "left_up"}, "drive.channels", "in this order: left_vertical"),
        ("rate", {"rate": 500.0}, "drive.sample_rate", "500 Hz; front_axle_compliant plays 1000 Hz only"),
        ("nan", {"value": np.nan}, "drive.samples", "nan"),
        ("far", {"value": 0.2}, "drive.samples", "left_longitudinal is 0.2 m"),
        ("unit", {"unit": "mm"}, "drive.channels", "left_vertical is in 'mm' instead of 'm'"),
        ("empty", {"samples": 0}, "drive.samples", "0 samples"),
    ],
)
def test_a_bad_request_is_refused_before_anything_moves(lab, run, change, field, said):
    drive = np.zeros((6, change.get("samples", 200)))
    if "value" in change:
        drive[2, 100] = change["value"]
    rows = change.get("rows", 6)
    record = to_record(lab.description.drives[:rows], change.get("rate", 1000.0), drive[:rows])
    record.channels[0].name = change.get("name", record.channels[0].name)
    record.channels[0].unit = change.get("unit", "m")
    request = rig_pb2.PlayRequest(run=run, drive=record)
    with pytest.raises(duralab_bus.FaultError) as caught:
        lab.bus.query(lab.bus.keys.rig_play(RIG), request, rig_pb2.PlayResult)
    fault = caught.value
    assert (fault.code_name, fault.field, fault.service) == ("INVALID_ARGUMENT", field, "rig_sim")
    assert said in fault.message
    assert lab.blocks_of(run) == []


def test_a_run_is_not_played_twice(lab):
    lab.play("once", wave(100))
    fault = lab.refused("once", wave(100))
    assert (fault.code_name, fault.field) == ("ALREADY_EXISTS", "run")


def test_both_rigs_play_at_once(lab):
    thread, outcome = lab.in_background("beside", wave(600))
    told = lab.bus.query(
        lab.bus.keys.rig_description("predecessor"), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription
    )
    request = rig_pb2.PlayRequest(run="road", drive=to_record(told.drives, 1000.0, np.zeros((8, 300))))
    result = lab.bus.query(lab.bus.keys.rig_play("predecessor"), request, rig_pb2.PlayResult)
    _, _, response = from_record(result.response)
    np.testing.assert_allclose(response.mean(axis=1), from_array(told.static_response), atol=5.0)
    thread.join(WAIT)
    assert outcome[0].run == "beside"


def test_a_service_that_ends_in_mid_play_ramps_down_and_says_so(tmp_path):
    with duralab_bus.open_bus(service="client") as bus:
        process = start(
            tmp_path,
            {"bus": {"connect": list(bus.listening)}, "rigs": ["front_axle_compliant"]},
            stderr=subprocess.DEVNULL,
        )
        bus.wait_for_live({("rig_sim", RIG)}, WAIT)
        lab = Lab(bus)
        thread, outcome = lab.in_background("last", wave(60_000))
        process.terminate()
        assert process.wait(WAIT) == 0
        thread.join(WAIT)
        assert outcome[0].code_name in {"CANCELLED", "UNAVAILABLE"}
        lab.wait_for(lambda: lab.blocks_of("last")[-1].message.last)


@pytest.fixture
def mule(tmp_path):
    """A rig of a user's own: the axle under another name, its drives as long as its cylinders."""
    folder = shipped_specimens()[RIG].parent
    (tmp_path / "front_axle.sdf").write_text((folder / "front_axle.sdf").read_text())
    text = (folder / "front_axle_compliant.yaml").read_text().replace("name: front_axle_compliant\n", "name: mule\n", 1)
    text = text.replace("minimum: -0.115, maximum: 0.115", "minimum: -0.125, maximum: 0.125")
    (tmp_path / "my mule.yaml").write_text(text)
    with duralab_bus.open_bus(service="client") as bus:
        config = {"bus": {"connect": list(bus.listening)}, "rigs": [], "specimens": [str(tmp_path / "my mule.yaml")]}
        process = start(tmp_path, config, stderr=subprocess.DEVNULL)
        try:
            bus.wait_for_live({("rig_sim", "mule")}, WAIT)
            yield bus
        finally:
            process.terminate()
            process.wait(WAIT)


def test_a_users_rig_is_live_under_its_own_name_and_tells_of_an_end_stop(mule):
    told = mule.query(mule.keys.rig_description("mule"), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    assert told.rig == "mule"
    drive = np.zeros((6, 1000))
    drive[0] = 0.125 * np.minimum(np.arange(1000) / 500.0, 1.0)
    for run in ("long", "again"):
        request = rig_pb2.PlayRequest(run=run, drive=to_record(told.drives, 1000.0, drive))
        with pytest.raises(
            duralab_bus.FaultError, match=r"the piston of left_vertical met its end stop \(125 mm\) at"
        ) as caught:
            mule.query(mule.keys.rig_play("mule"), request, rig_pb2.PlayResult)
        assert (caught.value.code_name, caught.value.field) == ("FAILED_PRECONDITION", "drive.samples")
        state = mule.query(mule.keys.rig_state("mule"), rig_pb2.StateRequest(), rig_pb2.RigState)
        assert state.mode == rig_pb2.RIG_MODE_INTERLOCKED
        assert state.reason in str(caught.value)
        mule.query(mule.keys.rig_reset("mule"), rig_pb2.ResetRequest(), rig_pb2.RigState)
