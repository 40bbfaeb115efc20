"""A rig simulator whose specimen wears: its state survives restart and kill, and only another specimen is new."""

import json
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest
import yaml
from wearing_quarter_car import GAIN, TYRE, quarter_car

import duralab_bus
from duralab_proto.arrays import from_record, to_record
from duralab_proto.v1 import rig_pb2
from rig_sim import SpecimenError, WearState, load_rig
from rig_sim.bus import SimulatedRig
from rig_sim.playing import WearFile

WAIT = 120.0
RIG = "quarter_car"
TIME = np.arange(1200) / 1000.0
#: It ends away from zero, so that the way back to rest wears too.
DRIVE = 0.02 * (np.sin(2 * np.pi * 3.0 * TIME) * np.minimum(TIME, 1.0))[None]


class Rig:
    """One life of a rig simulator, and a client of it."""

    def __init__(self, bus, process):
        self.bus, self.process = bus, process
        self.told = bus.query(bus.keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)

    def play(self, run, drive=DRIVE):
        request = rig_pb2.PlayRequest(run=run, drive=to_record(self.told.drives, 1000.0, drive), seed=1)
        result = self.bus.query(self.bus.keys.rig_play(RIG), request, rig_pb2.PlayResult)
        return from_record(result.response)[2].tobytes()


@contextmanager
def serving(folder, **changes):
    """Serve the rig in a process of its own."""
    with duralab_bus.open_bus(service="client") as bus:
        config = {
            "bus": {"connect": list(bus.listening)},
            "rigs": [],
            "specimens": [str(folder / "quarter_car.yaml")],
            "wear_folder": str(folder / "wear"),
        }
        path = folder / "rig_sim.yaml"
        path.write_text(yaml.safe_dump(config | changes))
        command = [sys.executable, "-m", "rig_sim", "--config", str(path)]
        process = subprocess.Popen(command, stderr=subprocess.PIPE)
        try:
            bus.wait_for_live({("rig_sim", RIG)}, WAIT)
            yield Rig(bus, process)
        finally:
            process.kill()  # always: what was answered is kept
            process.communicate(timeout=WAIT)


def stored(folder, specimen="specimen_1"):
    return WearState.model_validate_json((folder / "wear" / f"{RIG}.{specimen}.json").read_text())


def test_a_life_over_kills_and_restarts_is_the_same_bytes(tmp_path):
    quarter_car(tmp_path, TYRE | {"kind": "crack", "at_damage": 1.0e-4}, GAIN)
    here = SimulatedRig(load_rig(tmp_path / "quarter_car.yaml"))
    expected, states = [], []
    for _ in range(4):
        playback = here.playback(DRIVE, RunOf(1))
        for _ in (*playback.blocks(), *playback.ramp_down()):
            pass
        playback.end()
        expected.append(playback.response.tobytes())
        states.append(here.wear)
    assert len(set(expected)) == 4
    found = []
    with serving(tmp_path) as rig:
        told = rig.told
        found += [rig.play("a"), rig.play("b")]
        assert stored(tmp_path) == states[1]
    with serving(tmp_path) as rig:
        # Neither the description nor its hash knows how worn it is: models of this specimen stay its own.
        assert rig.told == told
        assert "specimen_1, WEARS: tyre, gain" in told.specimen
        found.append(rig.play("c"))
    with serving(tmp_path, mounted={RIG: "specimen_2"}) as rig:
        assert rig.told.content_hash != told.content_hash
        assert rig.play("new") == expected[0]
    with serving(tmp_path) as rig:
        found.append(rig.play("d"))
        assert stored(tmp_path) == states[3]
        assert stored(tmp_path, "specimen_2") == states[0]
    assert found == expected


class RunOf:
    def __init__(self, seed):
        self.seed = seed


def test_a_state_that_cannot_be_written_latches_the_rig(tmp_path):
    quarter_car(tmp_path, TYRE)
    # A folder where the file is to be written.
    (tmp_path / "wear" / "quarter_car.specimen_1.part").mkdir(parents=True)
    with serving(tmp_path) as rig:
        with pytest.raises(duralab_bus.FaultError, match="the wear of quarter_car cannot be written") as caught:
            rig.play("a")
        assert caught.value.message.endswith(".")
        state = rig.bus.query(rig.bus.keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState)
        assert state.mode == rig_pb2.RIG_MODE_INTERLOCKED


def test_what_was_played_of_a_broken_run_has_worn_it(tmp_path):
    path = quarter_car(tmp_path, TYRE, watchdogs={"responses": {"vertical": 4500.0}})
    with serving(tmp_path) as rig:
        # The wheel carries 3434 N at rest; a stroke of 4 cm at 2 Hz passes the watchdog.
        drive = 0.04 * (np.sin(2 * np.pi * 2.0 * TIME) * TIME)[None]
        with pytest.raises(duralab_bus.FaultError, match="was broken off"):
            rig.play("a", drive)
        state = stored(tmp_path)
    whole = load_rig(path)
    playback = whole.playback(drive, seed=1)
    for _ in playback.blocks():
        pass
    assert state.runs == 1
    assert state.damage["tyre"] > 0.0
    assert state.hours < (playback.samples_moved + 700) / 1000.0 / 3600.0


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"runs": 3', "is damaged"),
        ('{"runs": 3, "hours": -1.0, "damage": {}}', "hours is -1"),
        ('{"runs": 3, "hours": 1.0, "damage": {"wheel": 0.5}}', "is of wheel, but what wears is tyre"),
    ],
)
def test_a_state_of_something_else_is_refused(tmp_path, content, said):
    rig = load_rig(quarter_car(tmp_path, TYRE))
    (tmp_path / "quarter_car.specimen_1.json").write_text(content)
    with pytest.raises(SpecimenError) as caught:
        SimulatedRig(rig, wear_folder=tmp_path)
    assert said in str(caught.value)
    assert "Mount another specimen" in str(caught.value)


def test_a_state_is_read_back_to_the_last_bit(tmp_path):
    state = WearState(runs=7, hours=1.0 / 3.0, damage={"tyre": 0.1 + 0.2})
    file = WearFile(tmp_path / "new", rig=RIG, specimen="specimen_1")
    assert file.read({"tyre"}) == WearState()
    file.write(state)
    assert file.read({"tyre"}) == state
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["quarter_car.specimen_1.json"]
    assert json.loads(file.path.read_text())["runs"] == 7


def test_the_wear_is_among_the_metrics(tmp_path):
    rig = SimulatedRig(load_rig(quarter_car(tmp_path, TYRE, GAIN)))
    rig.wear = WearState(runs=4, hours=0.5, damage={"tyre": 0.25})
    with duralab_bus.open_bus(service="rig_sim") as bus:
        rig.follow_wear(bus.metrics)
        values = {family.name: family.values for family in bus.metrics.families()}
    assert values["duralab_rig_wear_damage"] == {(RIG, "tyre"): 0.25}
    assert values["duralab_rig_wear_runs"] == {(RIG,): 4.0}
    assert values["duralab_rig_wear_gain_change_ratio"] == {(RIG, "vertical"): pytest.approx(0.04)}
    assert values["duralab_rig_wear_lost_ratio"] == {
        (RIG, "tyre", "stiffness"): pytest.approx(0.1),
        (RIG, "tyre", "damping"): pytest.approx(0.125),
    }


@pytest.mark.parametrize(
    "config", [{"mounted": {"aerospace": "second"}, "rigs": ["aerospace"]}, {"mounted": {"front_axle": "b"}}]
)
def test_only_what_wears_can_have_another_specimen(tmp_path, config):
    path = tmp_path / "rig_sim.yaml"
    path.write_text(yaml.safe_dump({"rigs": ["front_axle"]} | config))
    command = [sys.executable, "-m", "rig_sim", "--config", str(path)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=WAIT, check=False)
    assert ended.returncode == 2
    assert "does not wear, so all its specimens are one; leave it out of mounted." in ended.stderr
