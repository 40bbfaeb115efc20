"""Playbacks played together give what each gives alone, and each ends as it does alone."""

import numpy as np
import pytest
import yaml
from wearing_quarter_car import TYRE, quarter_car

import rig_sim.playing.batch
from rig_sim import Lost, RigFaultError, load_rig, play_batch
from rig_sim.checks.proof import ProofError, check_lanes
from rig_sim.compile import LaneModel, lane_model
from rig_sim.playing import FaultKind, NoisySensor, StuckSensor

#: Of the root mean square of a response about its rest.
TOLERANCE = 1e-9


@pytest.fixture(scope="session")
def cars(tmp_path_factory):
    """Return quarter cars by what they differ by; the last two have another structure, or other steps."""

    def car(name, *, mass="330", tyre="2.1e5", faults=(), substeps=2, **law):
        folder = tmp_path_factory.mktemp(name)
        path = quarter_car(folder, TYRE, substeps=substeps)
        sdf = folder / "quarter_car.sdf"
        sdf.write_text(sdf.read_text().replace(">330<", f">{mass}<").replace("2.1e5", tyre))
        document = yaml.safe_load(path.read_text())
        document["struts"][0]["law"] |= law
        document["responses"][0]["noise_rms"] = 10.0
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        return load_rig(path, faults=faults)

    stuck = StuckSensor(kind=FaultKind.STUCK_SENSOR, channel="vertical", start=0.9)
    noisy = NoisySensor(kind=FaultKind.NOISY_SENSOR, channel="vertical", rms=5.0, start=0.2)
    return {
        "plain": car("plain"),
        "heavy": car("heavy", mass="400", faults=[stuck]),
        "stiff": car("stiff", tyre="3.3e5", stiffness=3.1e4, faults=[noisy]),
        "soft": car("soft", tyre="1.4e5", friction=55.0, rebound_damping=1800.0),
        "progressive": car("progressive", progression=2.0e5),
        "in short steps": car("short", substeps=4),
    }


def drive(seed, *, samples=1234, size=0.004):
    """Return some noise below 20 Hz about an offset, so that there is a way in."""
    random = np.random.default_rng(seed)
    lines = np.fft.rfft(random.standard_normal(samples))
    lines[np.fft.rfftfreq(samples, 1e-3) > 20.0] = 0.0
    record = np.fft.irfft(lines, n=samples)
    return (size * record / record.std() + 0.003)[None]


def alone(playback):
    blocks = [*playback.approach(), *playback.blocks()]
    assert blocks
    return playback


def assert_same(played, expected):
    assert played.samples_done == expected.samples_done
    assert played.samples_moved == expected.samples_moved
    assert played.block_samples == expected.block_samples
    done = played.samples_done
    motion = expected.response[:, :done] - expected.response[:, :done].mean(axis=1, keepdims=True)
    error = np.sqrt(np.mean((played.response - expected.response)[:, :done] ** 2, axis=1))
    assert (error <= TOLERANCE * np.sqrt(np.mean(motion**2, axis=1))).all()
    np.testing.assert_allclose(played.positions, expected.positions, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(played.loads(), expected.loads(), rtol=1e-7, atol=1e-6)
    for use, other in zip(played.uses(), expected.uses(), strict=True):
        assert use.drive == other.drive
        assert use.peak_command_ratio == other.peak_command_ratio
        assert use.saturated_share == other.saturated_share
        assert use.largest_following_error == pytest.approx(other.largest_following_error, rel=1e-9)
        assert use.largest_load_pressure_share == pytest.approx(other.largest_load_pressure_share, rel=1e-7)


def test_variants_with_drives_seeds_faults_and_wear_play_together_as_alone(cars):
    def made():
        worn = cars["soft"].changed({"tyre": Lost(stiffness=0.2, damping=0.3)})
        return [
            cars["plain"].playback(drive(1), seed=1),
            cars["heavy"].playback(drive(2, samples=900), seed=2),
            cars["progressive"].playback(drive(3), seed=3),
            cars["stiff"].playback(drive(4, samples=1500), seed=4),
            cars["soft"].playback(drive(5), seed=5, condition=worn),
            cars["in short steps"].playback(drive(6), seed=6),
            cars["soft"].playback(drive(7, samples=300), seed=7),
            cars["plain"].playback(drive(1), seed=8),
        ]

    together = made()
    assert play_batch(together) == [None] * 8
    for played, expected in zip(together, made(), strict=True):
        assert_same(played, alone(expected))
    assert not np.array_equal(together[0].response, together[-1].response)  # their noise differs


def test_a_batch_gives_the_same_bytes_again_and_a_playback_those_of_any_batch(cars, monkeypatch):
    def played(*names):
        batch = [cars[name].playback(drive(len(name)), seed=len(name)) for name in names]
        assert play_batch(batch) == [None] * len(names)
        return {name: playback.response.tobytes() for name, playback in zip(names, batch, strict=True)}

    first = played("plain", "heavy", "stiff", "soft")
    assert played("plain", "heavy", "stiff", "soft") == first
    assert played("soft", "plain", "stiff")["plain"] == first["plain"]
    monkeypatch.setattr(lane_model, "WIDTHS", (8,))
    monkeypatch.setattr(lane_model, "widest_lanes", lambda: 8)
    assert played("heavy", "soft", "stiff", "plain") == first


def test_who_meets_an_end_stop_ends_as_alone_and_nobody_else_does(cars):
    ramp = np.minimum(np.arange(1200) / 1000.0, 1.0)[None]

    def made():
        # More than there are lanes: one that ends makes room for the next.
        rest = [cars[name].playback(drive(seed), seed=seed) for seed, name in enumerate(("plain", "heavy", "soft") * 2)]
        return [cars["stiff"].playback(0.2 * ramp, seed=9), *rest, cars["plain"].playback(0.25 * ramp, seed=9)]

    together, expected = made(), made()
    ends = play_batch(together)
    assert ends[1:-1] == [None] * 6
    for end, playback in ((ends[0], expected[0]), (ends[-1], expected[-1])):
        with pytest.raises(RigFaultError) as caught:
            alone(playback)
        assert str(end) == str(caught.value)
        assert str(end).startswith("the piston of vertical met its end stop")
    assert 0 < together[0].samples_done < 1200
    for played, other in zip(together[1:-1], expected[1:-1], strict=True):
        assert_same(played, alone(other))
    assert_same(together[0], expected[0])


def test_rigs_whose_structure_or_steps_differ_are_not_put_together(cars, monkeypatch):
    groups = []
    as_before = rig_sim.playing.batch._play_in_lanes
    monkeypatch.setattr(
        rig_sim.playing.batch, "_play_in_lanes", lambda batch: (groups.append(len(batch)), as_before(batch))[1]
    )
    names = ["plain", "progressive", "stiff", "in short steps", "soft"]
    assert play_batch([cars[name].playback(drive(1, samples=50), seed=1) for name in names]) == [None] * 5
    assert groups == [3]


@pytest.mark.parametrize("lanes", [1, 4])
def test_without_vectors_and_for_two_all_play_alone(cars, monkeypatch, lanes):
    monkeypatch.setattr(rig_sim.playing.batch, "widest_lanes", lambda: lanes)
    monkeypatch.setattr(rig_sim.playing.batch, "_play_in_lanes", None)
    names = ("plain", "heavy") if lanes > 1 else ("plain", "heavy", "stiff", "soft")
    batch = [cars[name].playback(drive(1), seed=1) for name in names]
    assert play_batch(batch) == [None] * len(names)
    for name, playback in zip(names, batch, strict=True):
        expected = alone(cars[name].playback(drive(1), seed=1))
        assert playback.response.tobytes() == expected.response.tobytes()


def test_lanes_that_disagree_with_the_single_rig_must_not_play(cars, monkeypatch):
    rigs = [cars[name] for name in ("plain", "heavy", "stiff")]
    model = rig_sim.playing.batch._lane_model(tuple(rig.model for rig in rigs), 4)
    proven = [(rig.model, rig.compiled) for rig in rigs]
    assert check_lanes(model, proven) < 1e-12
    exact = LaneModel.evaluate

    def evaluate(self, variants, runs):
        answers = exact(self, variants, runs)
        answers[1][0][:] *= 1.0 + 1e-6  # of the second variant alone
        return answers

    monkeypatch.setattr(LaneModel, "evaluate", evaluate)
    with pytest.raises(ProofError, match="the player disagrees with that of the single rig at"):
        check_lanes(model, proven)


def test_lanes_are_proven_once_for_the_same_rigs(cars, monkeypatch):
    proofs = []

    def check(lanes, rigs):
        proofs.append(len(rigs))
        return check_lanes(lanes, rigs)

    monkeypatch.setattr(rig_sim.playing.batch, "widest_lanes", lambda: 4)
    monkeypatch.setattr(rig_sim.playing.batch, "check_lanes", check)
    rig_sim.playing.batch._lane_model.cache_clear()
    for names in (("plain", "heavy", "stiff"), ("plain", "heavy", "stiff"), ("heavy", "plain", "stiff")):
        play_batch([cars[name].playback(drive(1, samples=50), seed=1) for name in names])
    assert proofs == [3, 3]
