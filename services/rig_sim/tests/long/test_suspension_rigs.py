"""Every suspension rig that ships: proven, at rest where a car stands, damped, and finite under a random drive."""

import numpy as np
import pytest
from axles import MACPHERSON
from macpherson import write_sdf
from scipy import signal

from rig_sim import load_rig, shipped_specimens
from rig_sim.compile.integrate import amplification

RIGS = {
    "front_axle": (6, 6),
    "front_axle_compliant": (6, 6),
    "front_axle_sensors": (6, 18),
    "macpherson": (6, 6),
    "macpherson_compliant": (6, 6),
    "spindle_coupled": (6, 6),
    "spindle_coupled_braking": (8, 8),
}
#: Rigs whose lateral actuators hold the wheels at design track, whatever force that takes.
HELD = ("front_axle", "macpherson")
#: Of vertical, lateral, longitudinal on the left, seen in a mirror at y = 0.
SIGNS = {"vertical": 1.0, "lateral": -1.0, "longitudinal": 1.0}


@pytest.fixture(scope="module", params=RIGS)
def suspension(request):
    return load_rig(shipped_specimens()[request.param])


def by_name(rig):
    return dict(zip(rig.model.response_names, rig.static_response, strict=True))


def jacobian(rig):
    step, still = 1e-6, np.zeros(len(rig.specimen.drives))
    derivative = rig.compiled.derivative
    columns = [derivative(rig.rest + e, still) - derivative(rig.rest - e, still) for e in step * np.eye(len(rig.rest))]
    return np.array(columns).T / (2 * step)


def random_drive(rig, seconds=1.5):
    """Return a gentle random drive below 30 Hz that begins and ends at zero, as shares of the limits."""
    rng = np.random.default_rng(7)
    rate = rig.specimen.sample_rate
    noise = rng.standard_normal((len(rig.specimen.drives), round(seconds * rate)))
    smooth = signal.sosfilt(signal.butter(4, 30.0, fs=rate, output="sos"), noise) * signal.windows.hann(noise.shape[1])
    share = np.array([[channel.maximum] for channel in rig.specimen.drives])
    return 0.06 * share * smooth / np.abs(smooth).max()


def test_a_rig_has_the_channels_its_page_says(suspension):
    name = suspension.specimen.name
    assert (len(suspension.specimen.drives), len(suspension.specimen.responses)) == RIGS[name]


def test_a_rig_is_proven_against_drake(suspension):
    assert suspension.proof.acceleration_error < 1e-9
    assert suspension.proof.force_error < 1e-9
    assert suspension.proof.states >= 20


def test_a_rig_rests_with_mirrored_loads_of_a_car(suspension):
    static = by_name(suspension)
    for way, sign in SIGNS.items():
        assert static[f"right_{way}"] == pytest.approx(sign * static[f"left_{way}"], rel=1e-5, abs=0.5)
    # Half of an axle load of 0.6 to 1 t, and no side load that a standing car would not have.
    assert 2800.0 < static["left_vertical"] < 5200.0
    if suspension.specimen.name not in HELD:
        assert abs(static["left_lateral"]) < 0.1 * static["left_vertical"]
    assert abs(static["left_longitudinal"]) < 0.1 * static["left_vertical"]


@pytest.mark.parametrize("name", HELD)
def test_a_wheel_that_is_held_at_design_track_would_stand_free_a_fifth_of_a_millimetre_beside_it(name):
    rig = load_rig(shipped_specimens()[name])
    drive = np.zeros((6, 3000))
    shift = 0.2e-3 * np.minimum(np.arange(3000) / 1000.0, 1.0)
    drive[[1, 4]] = shift, -shift
    played = rig.compiled.play(rig.rest, drive, sample_interval=1e-3, substeps=1, method=rig.specimen.integrator)
    forces = dict(zip(rig.model.response_names, played.outputs[:6, -1], strict=True))
    # The side load at design track points inwards and 0.2 mm turn it round.
    assert by_name(rig)["left_lateral"] < 0.0 < forces["left_lateral"]
    assert forces["right_lateral"] < 0.0 < by_name(rig)["right_lateral"]


def test_no_mode_of_a_rig_rings(suspension):
    values = np.linalg.eigvals(jacobian(suspension))
    # What keeps any value at rest (friction, the load pressure's memory) has a rate of zero or nearly so.
    assert values.real.max() < 1e-6
    swinging = values[np.abs(values.imag) > 1.0]
    assert (-swinging.real / np.abs(swinging)).min() > 0.02


def test_the_step_is_stable_with_room_to_spare(suspension):
    values = np.linalg.eigvals(jacobian(suspension))
    step = 1.0 / (suspension.specimen.sample_rate * suspension.specimen.substeps)
    z = step * values
    assert amplification(z, suspension.specimen.integrator).max() < 1 + 1e-9
    assert amplification(1.2 * z, suspension.specimen.integrator).max() < 1 + 1e-6


def test_a_rig_plays_a_random_drive(suspension):
    drive = random_drive(suspension)
    playback = suspension.playback(drive, seed=1)
    for _ in playback.blocks():
        pass
    assert np.all(np.isfinite(playback.response))
    for channel, row, rest in zip(
        suspension.specimen.responses, playback.response, suspension.static_response, strict=True
    ):
        assert np.abs(row).max() < channel.range
        # A response that nothing moves would be a sensor in the wrong place.
        assert np.std(row - rest) > 3.0 * channel.noise_rms, channel.name
    assert max(use.saturated_share for use in playback.uses()) == 0.0


def test_the_shipped_macpherson_is_what_its_hard_points_give():
    assert shipped_specimens()["macpherson"].with_suffix(".sdf").read_text() == write_sdf(MACPHERSON)


def test_the_sides_of_the_macpherson_know_nothing_of_each_other():
    rig = load_rig(shipped_specimens()["macpherson"])
    drive = random_drive(rig, seconds=0.5)
    drive[3:] = 0.0
    played = rig.compiled.play(rig.rest, drive, sample_interval=1e-3, substeps=2).outputs[:6]
    np.testing.assert_allclose(played[3:], np.repeat(rig.static_response[3:, None], played.shape[1], axis=1), atol=1e-6)
    assert np.std(played[0]) > 50.0


def test_the_macpherson_struts_rod_slides_as_far_as_the_wheel_rises():
    # A strut beside the wheel follows it nearly one to one: its motion ratio is what tells it from a wishbone's strut.
    rig = load_rig(shipped_specimens()["macpherson"])
    tree = rig.model.assembly.tree
    slide = tree.joint("left_strut_slide").position_start
    stroke = tree.joint("left_vertical_stroke").position_start
    drive = np.zeros((6, 1500))
    drive[0] = 0.03 * np.minimum(np.arange(1500) / 500.0, 1.0)
    state = rig.compiled.play(rig.rest, drive, sample_interval=1e-3, substeps=2).state
    ratio = abs(state[slide] - rig.rest[slide]) / abs(state[stroke] - rig.rest[stroke])
    assert 0.88 < ratio < 1.02


def test_a_force_actuator_of_the_spindle_coupled_rig_pushes_the_spindle_with_what_it_is_told():
    rig = load_rig(shipped_specimens()["spindle_coupled"])
    drive = np.zeros((6, 3000))
    drive[1] = 800.0 * np.minimum(np.arange(3000) / 500.0, 1.0)
    played = rig.compiled.play(rig.rest, drive, sample_interval=1e-3, substeps=2).outputs
    change = played[:6, -1] - rig.static_response
    # All of the force goes through the fixture into the spindle; the vertical rod tilts and takes a little.
    assert change[1] == pytest.approx(800.0, rel=0.05)
    assert played[rig.compiled.output_names.index("left_lateral.force"), -1] == pytest.approx(800.0, rel=0.02)


def test_a_brake_actuator_makes_a_moment_of_its_arm_about_the_spindle():
    rig = load_rig(shipped_specimens()["spindle_coupled_braking"])
    names = rig.model.response_names
    drive = np.zeros((8, 4000))
    drive[6] = 1000.0 * np.minimum(np.arange(4000) / 1000.0, 1.0)
    played = rig.compiled.play(rig.rest, drive, sample_interval=1e-3, substeps=2).outputs[:8]
    change = dict(zip(names, played[:, -1] - rig.static_response, strict=True))
    # Forward at 0.28 m below the centre: by the right-hand rule about the axis to the left, negative.
    assert change["left_brake_moment"] == pytest.approx(-0.28 * 1000.0, rel=0.1)
    assert change["left_longitudinal"] == pytest.approx(1000.0, rel=0.1)
    assert abs(change["right_brake_moment"]) < 0.05 * 280.0
