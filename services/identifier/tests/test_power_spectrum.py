import numpy as np

from duralab_settings import TabulatedSpectrum, WhitePinkSpectrum
from identifier.excitation import power_density, white

FREQUENCY = np.array([0.0, 0.5, 1.0, 5.0, 10.0, 20.0, 40.0, 40.1])


def test_white_is_one_in_its_band_limits_included():
    np.testing.assert_array_equal(power_density(white(1.0, 40.0), FREQUENCY), [0, 0, 1, 1, 1, 1, 1, 0])


def test_white_pink_falls_by_its_slope_for_each_octave_above_the_corner():
    pink = WhitePinkSpectrum(
        lowest_frequency=1.0, highest_frequency=40.0, corner_frequency=10.0, decibels_per_octave=6.0
    )
    expected = [0, 0, 1, 1, 1, 10**-0.6, 10**-1.2, 0]
    np.testing.assert_allclose(power_density(pink, FREQUENCY), expected, rtol=1e-14)


def test_a_table_is_met_at_its_points_and_straight_on_logarithmic_axes_between():
    table = TabulatedSpectrum(frequency=(1.0, 10.0, 40.0), density=(2.0, 200.0, 50.0))
    # 2 f^2 up to 10 Hz, then 2000 / f.
    expected = [0, 0, 2.0, 50.0, 200.0, 100.0, 50.0, 0]
    np.testing.assert_allclose(power_density(table, FREQUENCY), expected, rtol=1e-13)
    assert (table.lowest_frequency, table.highest_frequency) == (1.0, 40.0)
