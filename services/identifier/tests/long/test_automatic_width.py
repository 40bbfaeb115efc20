"""A local method that chooses its width errs no more than H1, whatever the excitation."""

import numpy as np
import pytest
from known_plants import SixModes

from duralab_settings import EstimatorKind, ExcitationKind
from identifier.estimators import EstimatorOptions, WarningCode, estimate
from identifier.excitation import ExperimentSettings, design_experiment, white

LOCAL = (EstimatorKind.LOCAL_POLYNOMIAL, EstimatorKind.LOCAL_RATIONAL)
H1 = EstimatorKind.H1


def played(kind, *, noise=0.01, damping=0.05, seconds=240.0, **changes):
    plant = SixModes(damping=damping)
    settings = ExperimentSettings(
        kind=kind, drive_spectra=(white(0.5, 60.0),) * 6, rms=(1.0,) * 6, duration=seconds, fade=0.25, seed=5,
        block_samples=plant.BLOCK, **changes,
    )  # fmt: skip
    experiment = design_experiment(settings, drives=6, sample_rate=plant.RATE)
    response = plant.respond(experiment.drive)
    level = noise * np.std(response, axis=1, keepdims=True)
    response += level * np.random.default_rng(6).standard_normal(response.shape)
    return plant, experiment, response


def errors(plant, experiment, response, kinds=(H1, *LOCAL), **options):
    record = (experiment.drive, response, experiment.layout, EstimatorOptions(**options))
    return [plant.error(estimate(kind, *record)) for kind in kinds]


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
@pytest.mark.parametrize(
    "kind",
    [
        ExcitationKind.RANDOM_ORTHOGONAL,
        ExcitationKind.PSEUDO_RANDOM,
        ExcitationKind.HADAMARD,
        ExcitationKind.BURST_RANDOM,
        ExcitationKind.SWEPT_SINE,
        ExcitationKind.PURE_RANDOM,
    ],
)
def test_a_chosen_width_is_never_worse_than_h1(kind, noise):
    h1, polynomial, rational = errors(*played(kind, noise=noise, seconds=120.0))
    # Without noise what is left of the transients, 1e-5 of the FRF, stands for it.
    assert polynomial <= 1.02 * h1 + 1e-5
    assert rational <= 1.02 * h1 + 1e-5
    if noise == 0.1:
        assert max(polynomial, rational) < 0.9 * h1


def test_on_a_long_random_record_a_chosen_width_is_many_times_better_than_h1():
    h1, polynomial, rational = errors(*played(ExcitationKind.PURE_RANDOM))
    assert h1 > 0.03
    assert polynomial < 0.0055
    assert rational < 0.0032


@pytest.mark.parametrize("kind", LOCAL)
def test_modes_far_narrower_than_the_lines_are_left_to_h1_and_the_rest_is_smoothed(kind):
    plant, experiment, response = played(ExcitationKind.RANDOM_ORTHOGONAL, damping=0.01)
    found = estimate(kind, experiment.drive, response, experiment.layout)
    narrow = found.half_width[found.valid & (found.frequency > 10.5) & (found.frequency < 22.5)]
    wide = found.half_width[found.frequency > 40.0]
    assert np.median(narrow) <= 3
    assert np.median(wide[wide > 0]) >= 8
    assert plant.error(found) <= errors(plant, experiment, response, kinds=[H1])[0]


@pytest.mark.parametrize("kind", LOCAL)
@pytest.mark.parametrize("excitation", [ExcitationKind.RANDOM_ORTHOGONAL, ExcitationKind.BURST_RANDOM])
def test_what_a_fixed_width_smooths_away_needs_no_warning_where_the_width_is_chosen(kind, excitation):
    plant, experiment, response = played(excitation, seconds=120.0)
    record = (experiment.drive, response, experiment.layout)
    fixed = estimate(kind, *record, EstimatorOptions(half_width=16))
    chosen = estimate(kind, *record)
    assert plant.error(fixed) > 20.0 * plant.error(chosen)
    assert {warning.code for warning in fixed.warnings} == {WarningCode.SMOOTHED}
    assert chosen.warnings == ()


@pytest.mark.parametrize("kind", LOCAL)
def test_as_many_captures_as_drives_are_enough(kind):
    plant, experiment, response = played(
        ExcitationKind.RANDOM_ORTHOGONAL, noise=0.05, seconds=80.0, realisations=1, delay_blocks=1
    )
    h1, chosen = errors(plant, experiment, response, kinds=[H1, kind])
    assert chosen <= 1.02 * h1
    found = estimate(kind, experiment.drive, response, experiment.layout)
    assert np.all(found.degrees_of_freedom[found.valid] > 0.0)


@pytest.mark.parametrize("kind", LOCAL)
def test_the_variance_at_lines_of_any_width_is_the_error_that_is_made(kind):
    plant, experiment, response = played(ExcitationKind.RANDOM_ORTHOGONAL, noise=0.1)
    found = estimate(kind, experiment.drive, response, experiment.layout)
    lines = found.valid & (found.frequency >= 1.0) & (found.frequency <= 50.0)
    inverse = np.einsum("fjj->fj", np.linalg.inv(found.s_uu[lines])).real
    variance = found.residual_psd[lines][:, :, None] * inverse[:, None, :] / found.averages[lines][:, None, None]
    size = np.linalg.norm(found.frf[lines])
    assert np.sqrt(np.sum(variance)) / size == pytest.approx(plant.error(found), rel=0.3)


def test_a_unit_of_a_channel_does_not_change_the_choice():
    _, experiment, response = played(ExcitationKind.RANDOM_ORTHOGONAL, seconds=80.0)
    first = estimate(LOCAL[0], experiment.drive, response, experiment.layout)
    unit = np.array([1e3, 1.0, 1e-3, 1.0, 1.0, 1.0])[:, None]
    other = estimate(LOCAL[0], experiment.drive, unit * response, experiment.layout)
    np.testing.assert_array_equal(first.half_width, other.half_width)
