import numpy as np
import pytest

import duralab_spectra

BAND = {"lowest": 2.0, "sample_rate": 200.0}


def test_the_static_part_is_the_line_between_the_levels_at_both_ends():
    # Five samples at either end: a twentieth of a period of 2 Hz.
    level = np.linspace([3600.0, -2.0], [3580.0, 5.0], 3001, axis=1)
    levels = duralab_spectra.static_levels(level, **BAND)
    np.testing.assert_allclose(levels, np.stack([level[:, 2], level[:, -3]], axis=1))
    assert np.max(np.abs(duralab_spectra.dynamic_part(level, **BAND))) < 0.02


def test_what_moves_between_two_rests_stays_as_it_is():
    moving = np.zeros((1, 1001))
    moving[0, 100:900] = np.random.default_rng(1).standard_normal(800) + 3.0
    ramp = np.linspace(10.0, 30.0, 1001)
    np.testing.assert_array_equal(duralab_spectra.dynamic_part(moving, **BAND), moving)
    np.testing.assert_allclose(duralab_spectra.dynamic_part(moving + ramp, **BAND), moving, atol=0.05)


@pytest.mark.parametrize("samples", [1, 3, 7])
def test_a_short_record_is_all_end(samples):
    record = np.full((2, samples), 4.0)
    np.testing.assert_array_equal(duralab_spectra.dynamic_part(record, **BAND), np.zeros((2, samples)))


@pytest.mark.parametrize("lowest", [0.0, -1.0, np.nan])
def test_a_band_that_begins_at_0_has_no_static_part_besides(lowest):
    with pytest.raises(ValueError, match=r"begins at .* Hz"):
        duralab_spectra.static_levels(np.zeros((1, 10)), lowest=lowest, sample_rate=200.0)
