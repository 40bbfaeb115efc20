import numpy as np
import pytest

import duralab_spectra

LINES = 33
FREQUENCY = np.linspace(0.0, 32.0, LINES)


def random_frf(n_y, n_u, seed=0):
    generator = np.random.default_rng(seed)
    return generator.standard_normal((LINES, n_y, n_u)) + 1j * generator.standard_normal((LINES, n_y, n_u))


def test_a_square_frf_times_its_inverse_is_the_identity():
    frf = random_frf(6, 6)
    inverse = duralab_spectra.inverse_frf(frf, mask=np.ones(LINES), frequency=FREQUENCY)
    np.testing.assert_allclose(frf @ inverse, np.broadcast_to(np.eye(6), (LINES, 6, 6)), atol=1e-11)


def test_a_tall_frf_gives_the_least_squares_drive():
    frf, weight = random_frf(5, 3), np.array([1.0, 2.0, 0.5, 3.0, 1.0])
    inverse = duralab_spectra.inverse_frf(frf, mask=np.ones(LINES), frequency=FREQUENCY, row_weight=weight)
    target = np.random.default_rng(9).standard_normal(5)
    for line in range(LINES):
        expected = np.linalg.lstsq(weight[:, None] * frf[line], weight * target, rcond=None)[0]
        np.testing.assert_allclose(inverse[line] @ target, expected, atol=1e-12)


def test_units_of_the_drives_do_not_make_a_matrix_singular():
    frf = random_frf(4, 4) * np.array([1.0, 1e9, 1e-9, 1.0])
    inverse = duralab_spectra.inverse_frf(frf, mask=np.ones(LINES), frequency=FREQUENCY)
    np.testing.assert_allclose(frf @ inverse, np.broadcast_to(np.eye(4), (LINES, 4, 4)), atol=1e-11)


def test_a_pseudo_inverse_is_the_same_in_other_units_of_the_columns():
    frf, units = random_frf(5, 3), np.array([1.0, 1e15, 1e-15])
    inverse = duralab_spectra.pseudo_inverse(frf * units)
    np.testing.assert_allclose(inverse * units[:, None], np.linalg.pinv(frf), atol=1e-12)


def test_a_pseudo_inverse_leaves_a_silent_column_at_rest():
    frf = random_frf(5, 3)
    frf[7, :, 1] = 0.0
    inverse = duralab_spectra.pseudo_inverse(frf)
    np.testing.assert_allclose(inverse[7], np.linalg.pinv(frf[7]), atol=1e-12)
    assert not inverse[7, 1].any()


def test_lines_outside_the_mask_are_neither_judged_nor_inverted():
    frf = random_frf(3, 3)
    frf[:4] = 0.0
    frf[20:] = 1e-30
    mask = duralab_spectra.band_mask(FREQUENCY, 4.0, 19.0, edge=3.0)
    inverse = duralab_spectra.inverse_frf(frf, mask=mask, frequency=FREQUENCY)
    assert not np.any(inverse[mask == 0.0])
    np.testing.assert_allclose((frf @ inverse)[10], np.eye(3), atol=1e-12)
    np.testing.assert_allclose((frf @ inverse)[5], mask[5] * np.eye(3), atol=1e-12)


def test_a_singular_line_in_the_band_is_refused_by_its_frequency():
    frf = random_frf(3, 3)
    frf[7, :, 2] = frf[7, :, 1] * (2.0 + 1j)
    with pytest.raises(ValueError, match=r"singular at 7 Hz: its condition number is .* narrow the band"):
        duralab_spectra.inverse_frf(frf, mask=np.ones(LINES), frequency=FREQUENCY)
    frf[7, :, 2] = 0.0
    with pytest.raises(ValueError, match=r"No response moves with drive 2 at 7 Hz"):
        duralab_spectra.inverse_frf(frf, mask=np.ones(LINES), frequency=FREQUENCY)


@pytest.mark.parametrize(
    ("frf", "mask", "message"),
    [
        (random_frf(2, 3), np.ones(LINES), "at least as many responses"),
        (random_frf(3, 3), np.ones(5), "one value for each"),
        (random_frf(3, 3), np.zeros(LINES), "0 at every line"),
        (random_frf(3, 3), np.full(LINES, 1.5), "between 0 and 1"),
        (random_frf(3, 3) * np.nan, np.ones(LINES), "must be finite"),
    ],
)
def test_unusable_input_is_refused(frf, mask, message):
    with pytest.raises(ValueError, match=message):
        duralab_spectra.inverse_frf(frf, mask=mask, frequency=FREQUENCY)
