"""The player's step: the bound is the method's own, and what breaks it is named before anything is played."""

from types import SimpleNamespace

import numpy as np
import pytest

from rig_sim.checks.equilibrium import linearise
from rig_sim.checks.step_check import MARGIN, StepError, check_step, largest_stable_step
from rig_sim.compile import Method, amplification, compile_model
from rig_sim.playing.player import load_rig
from rig_sim.specimen.specimen import shipped_specimens


@pytest.mark.parametrize(
    ("eigenvalues", "reach"),
    [([-1000.0], 2.785294), ([1000j, -1000j], 2.0 * np.sqrt(2.0)), ([-10.0, -1000.0 + 0j, 0.0], 2.785294)],
)
def test_the_bound_on_real_and_imaginary_axes_is_the_textbooks(eigenvalues, reach):
    expected = reach / 1000.0 / MARGIN
    longest = largest_stable_step(np.array(eigenvalues, dtype=complex), Method.RUNGE_KUTTA_4)
    assert longest == pytest.approx(expected, rel=3e-4)


def test_with_the_tuned_method_no_undamped_motion_grows():
    assert amplification(1j * np.linspace(0.0, 4.0, 2001), Method.TUNED_3).max() <= 1.0 + 1e-12
    assert amplification(1j * np.linspace(0.0, 4.0, 2001), Method.VERNER_6).max() > 1.1


@pytest.mark.parametrize("method", Method)
@pytest.mark.parametrize("pole", [-1000.0 + 0j, -300.0 + 1000.0j, -20.0 + 1000.0j])
def test_a_motion_decays_just_below_the_bound_and_grows_just_above(method, pole):
    model = compile_model(
        lambda s, u: ([pole.real * s[0] - pole.imag * s[1], pole.imag * s[0] + pole.real * s[1]], []),
        state_names=["real", "imaginary"],
        input_names=[],
    )
    longest = MARGIN * largest_stable_step(np.array([pole]), method)

    def size(step):
        played = model.play([1.0, 0.0], np.empty((0, 1001)), sample_interval=step, substeps=1, method=method)
        return np.linalg.norm(played.state)

    assert size(0.99 * longest) < 0.9
    assert size(1.01 * longest) > 1.5


def test_what_does_not_move_bounds_no_step():
    assert largest_stable_step(np.zeros(3, dtype=complex), Method.VERNER_6) == np.inf


def test_what_grows_by_itself_is_not_the_steps_fault():
    assert largest_stable_step(np.array([5.0 + 0j]), Method.VERNER_6) == np.inf


def stiff_pair(stiffness):
    def model(state, inputs):
        x, v, soft, rate = state
        return [v, -stiffness * x - 2.0 * v, rate, inputs[0] - 9.0 * soft], [x]

    return compile_model(model, state_names=["rod x", "rod v", "soft x", "soft v"], input_names=["force"])


def check(model, substeps):
    specimen = SimpleNamespace(name="rods", sample_rate=1000.0, substeps=substeps, integrator=Method.RUNGE_KUTTA_4)
    at_rest = linearise(model.derivative, np.zeros(4), np.zeros(1))
    check_step(at_rest, names=model.state_names, specimen=specimen)


def test_a_stiff_rod_is_named_with_the_substeps_that_would_do():
    rod = stiff_pair(4000.0**2)
    with pytest.raises(
        StepError, match=r"rods: the step of 1 ms \(1 substeps\) is unstable: 'rod [xv]' .*take substeps: 2 or"
    ):
        check(rod, 1)
    check(rod, 2)


@pytest.mark.parametrize("substeps", [1, 2])
def test_what_is_refused_diverges_and_what_is_let_through_does_not(substeps):
    rod = stiff_pair(4000.0**2)
    played = rod.play([1e-3, 0, 0, 0], np.zeros((1, 2001)), sample_interval=1e-3, substeps=substeps, bounds=[10.0] * 4)
    assert (played.diverged_at is None) == (np.abs(played.state[1]) < 4.0) == (substeps == 2)


def test_a_specimen_whose_step_is_too_long_does_not_load(tmp_path):
    source = shipped_specimens()["predecessor"]
    text = source.read_text()
    for path in source.parent.glob("*.sdf"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    copy = tmp_path / source.name
    copy.write_text(text.replace("sample_rate: 1000.0", "sample_rate: 400.0"))
    with pytest.raises(StepError, match=r"predecessor: the step of 2.5 ms \(1 substeps\) is unstable: "):
        load_rig(copy)
