"""What is lost at a damage, and how much damage a load does."""

import numpy as np
import pytest
from wearing_quarter_car import GAIN, STRUT, TYRE, quarter_car

from rig_sim import SpecimenError, WearState, load_rig
from rig_sim.playing.wear import damage_of, gain_changes, lost_by
from rig_sim.specimen import Crack, Softening, load_specimen


def softening(**changes):
    return Softening.model_validate(TYRE | changes)


def test_softening_is_a_line_from_its_onset_to_damage_1_and_holds():
    wear = softening(from_damage=0.2)
    shares = [wear.grown(damage) for damage in (0.0, 0.2, 0.4, 0.6, 1.0, 7.0)]
    assert shares == pytest.approx([0.0, 0.0, 0.25, 0.5, 1.0, 1.0])


def test_growth_bends_the_line():
    assert softening(growth=3.0).grown(0.5) == pytest.approx(0.125)


def test_a_crack_is_there_from_its_damage_on():
    wear = Crack.model_validate(TYRE | {"kind": "crack", "at_damage": 0.7})
    assert [wear.grown(damage) for damage in (0.0, 0.6999, 0.7, 5.0)] == [0.0, 0.0, 1.0, 1.0]


def test_damage_is_the_miner_sum_of_the_rainflow_cycles_of_the_load(quarter):
    # 20 whole cycles of 600 N about a mean, and half a cycle to and from it, which is of half the range.
    time = np.arange(20 * 500 + 1) / 500.0
    load = 3000.0 + 300.0 * np.sin(2 * np.pi * time)
    part = next(part for part in quarter.model.assembly.wearing if part.name == "tyre")
    expected = (19.5 * 0.6**3 + 2 * 0.5 * 0.3**3) / 100.0
    assert damage_of(part, load) == pytest.approx(expected, rel=1e-3)
    assert damage_of(part, 2.0 * load) == pytest.approx(8.0 * expected, rel=1e-3)


def test_the_counted_loads_are_those_of_the_parts(quarter):
    time = np.arange(6000) / 1000.0
    drive = 0.01 * (np.sin(2 * np.pi * time) * np.sin(np.pi * time / 6.0) ** 2)[None]
    playback = quarter.playback(drive, seed=1)
    for _ in playback.blocks():
        pass
    tyre, travel = playback.loads()
    # The tyre's force on the pan: what the spindle feels, the wheel of 20 kg, and what moves it (here up to 0.4 m/s^2).
    assert tyre[0] == pytest.approx(-370.0 * 9.81, rel=1e-6)
    np.testing.assert_allclose(tyre, -(playback.response[0] + 20.0 * 9.81), atol=20.0 * 0.6)
    # Body and wheel move nearly alike far below the body's own frequency, so the strut hardly works.
    assert 0.0 < np.ptp(travel) < 0.02
    state = quarter.worn(WearState(), playback)
    assert state.damage == {
        part.name: damage_of(part, load)
        for part, load in zip(quarter.model.assembly.wearing, (tyre, travel), strict=True)
    }
    assert (state.runs, state.hours) == (1, pytest.approx(6.0 / 3600.0))


def test_a_state_says_what_is_lost(quarter):
    state = WearState(runs=3, hours=1.0, damage={"tyre": 0.5, "damper": 2.0})
    lost = lost_by(quarter.model.assembly.wearing, state)
    assert (lost["tyre"].stiffness, lost["tyre"].damping) == pytest.approx((0.2, 0.25))
    assert (lost["damper"].stiffness, lost["damper"].damping) == (0.0, 0.5)
    assert gain_changes(quarter.model, state) == {"vertical": pytest.approx(0.03)}


def test_gain_drifts_by_the_hour_after_its_hours(tmp_path):
    drift = {"name": "gain", "kind": "gain_drift", "channel": "vertical", "per_hour": -0.01, "from_hours": 2.0}
    rig = load_rig(quarter_car(tmp_path, drift))
    assert gain_changes(rig.model, WearState(runs=9, hours=1.5)) == {"vertical": 0.0}
    assert gain_changes(rig.model, WearState(runs=9, hours=3.0)) == {"vertical": pytest.approx(-0.01)}


@pytest.mark.parametrize(
    ("wear", "said"),
    [
        (TYRE | {"stiffness_lost": 1.0}, "wear.0.stiffness_lost is 1"),
        (TYRE | {"stiffness_lost": 0.0, "damping_lost": 0.0}, "'tyre' loses nothing; give stiffness_lost"),
        (TYRE | {"exponent": 0.0}, "wear.0.exponent is 0"),
        (TYRE | {"reference_range": float("nan")}, "reference_range"),
        (TYRE | {"from_damage": 1.0}, "from_damage is 1"),
        (TYRE | {"kind": "rust"}, "gain_drift"),
        (TYRE | {"color": "red"}, "color"),
        (TYRE | {"kind": "crack"}, "at_damage is missing"),
        (STRUT | {"stiffness_lost": 0.1}, "'damper' is of a strut, which loses damping only"),
        (GAIN | {"per_hour": 0.1}, "'gain' must have per_run or per_hour, and not both"),
        (TYRE | {"mirrored": True}, "'tyre' is mirrored, so its name must begin with"),
    ],
)
def test_wear_that_cannot_be_is_refused(tmp_path, wear, said):
    with pytest.raises(SpecimenError) as caught:
        load_specimen(quarter_car(tmp_path, wear))
    assert said in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    ("wears", "said"),
    [
        ([TYRE, TYRE | {"name": "again"}], "wear 'again': its part wears already; give each part one wear."),
        ([STRUT, STRUT | {"name": "again"}], "wear 'again': its part wears already; give each part one wear."),
        ([TYRE, STRUT | {"name": "tyre"}], "two wears are called 'tyre'"),
        (
            [TYRE | {"part": {"frame_a": "pan", "frame_c": "wheel", "axis": "z"}}],
            "the SDF has 0 of them, and must have one",
        ),
        ([TYRE | {"part": {"body_a": "piston", "body_b": "wheel"}}], "the SDF has 0 springs between them"),
        ([STRUT | {"part": {"strut": "left"}}], "wear 'damper': it is of strut 'left'; there are strut."),
        ([GAIN | {"channel": "lateral"}], "wear 'gain' is of response 'lateral'; there are vertical."),
    ],
)
def test_wear_of_what_is_not_there_is_refused(tmp_path, wears, said):
    with pytest.raises(SpecimenError) as caught:
        load_rig(quarter_car(tmp_path, *wears))
    assert said in str(caught.value)
    assert str(caught.value).endswith(".")
