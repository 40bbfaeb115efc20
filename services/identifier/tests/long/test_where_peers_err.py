"""Identifications in which other tools of the field were found to go wrong, with what they do."""

import numpy as np
import pytest
from known_plants import PLANT, RATE, error, noise_layout, periodic_experiment, respond, true_frf

from duralab_settings import EstimatorKind
from duralab_spectra import cross_spectra
from identifier import SpectralSums, WarningCode, estimate

SQUARE = PLANT[:2]
CHOSEN = {"block_samples": 1024, "overlap": 0.5, "sample_rate": RATE}


def noise(channels, samples, seed=0):
    return np.random.default_rng(seed).standard_normal((channels, samples))


def test_h2_is_right_for_a_plant_that_is_not_symmetric():
    """`S_uy` is not Hermitian: a pseudo-inverse for Hermitian matrices reads one half of it and gives another plant."""
    drive, layout = periodic_experiment(experiments=6)
    response = respond(drive, SQUARE)
    sums = SpectralSums(layout, drives=2, responses=2, full=True)
    sums.add(drive, response)
    averages = sums.averages()
    lines = np.flatnonzero(layout.excited)
    s_uy = averages.s_yu[lines].conj().transpose(0, 2, 1)
    expected = true_frf(averages.frequency[lines], SQUARE)
    size = np.linalg.norm(expected, axis=(1, 2))
    wrong = averages.s_yy[lines] @ np.linalg.pinv(s_uy, hermitian=True)
    assert np.median(np.linalg.norm(wrong - expected, axis=(1, 2)) / size) > 0.5
    assert np.median(error(estimate(EstimatorKind.H2, drive, response, layout), SQUARE)) <= 1e-9


def test_drives_of_rank_one_are_refused_though_the_coherence_is_high():
    """The coherence of two drives that are one reads 1, and a pseudo-inverse gives an FRF without a word."""
    first = noise(1, 60_000)
    drive = np.concatenate((first, 0.5 * first))
    response = respond(drive) + 0.01 * noise(3, 60_000, seed=1)
    s_yu, s_uu = cross_spectra(response, drive, **CHOSEN), cross_spectra(drive, drive, **CHOSEN)
    wrong = s_yu @ np.linalg.pinv(s_uu, rcond=1e-10, hermitian=True)
    explained = np.einsum("fij,fij->fi", wrong, s_yu.conj()).real
    power = np.einsum("fii->fi", cross_spectra(response, response, **CHOSEN)).real
    inside = slice(2, 100)
    assert np.median(explained[inside] / power[inside]) > 0.99
    expected = true_frf(np.arange(513) * (RATE / 1024))
    missed = np.linalg.norm(wrong - expected, axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))
    assert np.median(missed[inside]) > 0.4
    for kind in (EstimatorKind.H1, EstimatorKind.HV):
        with pytest.raises(ValueError, match=r"condition number.*drives 0 and 1 are most alike"):
            estimate(kind, drive, response, noise_layout(60_000))


def test_what_all_drives_explain_together_is_the_coherence():
    """With one drive at a time the coherence of a clean measurement is poor: the other drives look like noise."""
    drive = noise(2, 120_000)
    response = respond(drive)
    found = estimate(EstimatorKind.H1, drive, response, noise_layout(120_000))
    s_yu = cross_spectra(response, drive, **CHOSEN)
    ordinary = np.abs(s_yu) ** 2 / (found.response_psd[:, :, None] * found.drive_psd[:, None, :])
    assert np.min(np.median(np.max(ordinary[found.valid], axis=2), axis=0)) < 0.8
    assert np.min(np.median(found.coherence[found.valid], axis=0)) > 0.99


@pytest.mark.parametrize(("periods", "experiments", "few"), [(1, 1, True), (3, 1, True), (1, 2, False)])
def test_no_more_averages_than_drives_are_said_to_prove_nothing(periods, experiments, few):
    """From as many blocks as drives the coherence of pure noise is 1, and the error bars that follow from it are 0."""
    drive, layout = periodic_experiment(periods=periods, experiments=experiments, delay=1, drives=1)
    found = estimate(EstimatorKind.H1, drive, noise(3, drive.shape[1]), layout)
    assert (WarningCode.FEW_AVERAGES in [warning.code for warning in found.warnings]) == few
    assert np.all((found.degrees_of_freedom[found.valid] > 0.0) != few)
    if not few:
        assert np.median(found.coherence[found.valid]) < 0.8
        return
    np.testing.assert_allclose(found.coherence[found.valid], 1.0, atol=1e-9)


def test_a_drive_that_moves_one_response_only_has_its_own_column():
    """Rows and columns are easily swapped where the plant on which a tool was tried is symmetric."""
    drive, layout = periodic_experiment(experiments=6)
    plant = [[([2.0], [1.0]), ([0.0, 3.0], [1.0])], [([0.0], [1.0]), ([1.0], [1.0])]]
    found = estimate(EstimatorKind.H1, drive, respond(drive, plant), layout)
    frf = found.frf[found.valid]
    np.testing.assert_allclose(frf[:, 0, 0], 2.0, atol=1e-10)
    np.testing.assert_allclose(np.abs(frf[:, 0, 1]), 3.0, atol=1e-10)
    np.testing.assert_allclose(frf[:, 1], [[0.0, 1.0]] * frf.shape[0], atol=1e-10)


def test_densities_hold_the_power_of_the_record_with_its_mean_and_its_highest_frequency():
    """Levels at the first and the last line come out twice too high where every line is doubled."""
    drive, layout = periodic_experiment(periods=3)
    response = respond(drive)[:1] + 7.0 + 5.0 * (-1.0) ** np.arange(drive.shape[1])
    found = estimate(EstimatorKind.H1, drive, response, layout)
    captured = np.concatenate([response[:, c.start : c.start + 3 * 1024] for c in layout.captures], axis=1)
    assert np.sum(found.response_psd) * RATE / 1024 == pytest.approx(np.mean(captured**2), rel=1e-12)
    assert found.response_psd[0, 0] * RATE / 1024 == pytest.approx(49.0, rel=1e-6)


def test_tiny_units_do_not_lower_the_coherence():
    """A fixed small number in the denominator of a coherence turns displacements in metres into noise."""
    drive = noise(2, 60_000)
    response = respond(drive) + 0.1 * noise(3, 60_000, seed=1)
    plain, tiny = (
        estimate(EstimatorKind.H1, size * drive, size * response, noise_layout(60_000)) for size in (1.0, 1e-14)
    )
    np.testing.assert_allclose(tiny.coherence, plain.coherence, rtol=1e-9)
    np.testing.assert_allclose(tiny.frf, plain.frf, atol=1e-9 * np.max(np.abs(plain.frf)))
