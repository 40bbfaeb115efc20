import numpy as np
import pytest

import duralab_spectra


def test_the_floor_is_the_noise_that_was_added_whatever_the_signal():
    rng = np.random.default_rng(0)
    signal = 100.0 * rng.standard_normal((2, 20000))
    level = np.array([[0.5], [3.0]])
    repeats = [signal + level * rng.standard_normal(signal.shape) for _ in range(4)]
    np.testing.assert_allclose(duralab_spectra.noise_floor(repeats), level[:, 0], rtol=0.02)
    # Two repeats estimate the same, with more scatter: it is free of bias.
    np.testing.assert_allclose(duralab_spectra.noise_floor(repeats[:2]), level[:, 0], rtol=0.03)


def test_a_rig_that_repeats_itself_has_no_floor():
    np.testing.assert_array_equal(duralab_spectra.noise_floor([np.ones((1, 5))] * 3), 0.0)


@pytest.mark.parametrize("repeats", [[], [np.ones((1, 5))], [np.ones((1, 5)), np.ones((1, 6))]])
def test_one_record_or_records_of_other_drives_tell_nothing(repeats):
    with pytest.raises(ValueError, match=r"two or more|must be equal"):
        duralab_spectra.noise_floor(repeats)
