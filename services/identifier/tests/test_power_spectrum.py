import numpy as np
import pytest

from identifier.excitation import TabulatedSpectrum, White, WhitePink
from identifier.setting_error import SettingError

FREQUENCY = np.array([0.0, 0.5, 1.0, 5.0, 10.0, 20.0, 40.0, 40.1])


def test_white_is_one_in_its_band_limits_included():
    np.testing.assert_array_equal(White(1.0, 40.0).density(FREQUENCY), [0, 0, 1, 1, 1, 1, 1, 0])


def test_white_pink_falls_by_its_slope_for_each_octave_above_the_corner():
    pink = WhitePink(lowest_frequency=1.0, highest_frequency=40.0, corner_frequency=10.0, decibels_per_octave=6.0)
    expected = [0, 0, 1, 1, 1, 10**-0.6, 10**-1.2, 0]
    np.testing.assert_allclose(pink.density(FREQUENCY), expected, rtol=1e-14)


def test_a_table_is_met_at_its_points_and_straight_on_logarithmic_axes_between():
    table = TabulatedSpectrum(frequencies=(1.0, 10.0, 40.0), densities=(2.0, 200.0, 50.0))
    # 2 f^2 up to 10 Hz, then 2000 / f.
    expected = [0, 0, 2.0, 50.0, 200.0, 100.0, 50.0, 0]
    np.testing.assert_allclose(table.density(FREQUENCY), expected, rtol=1e-13)
    assert (table.lowest_frequency, table.highest_frequency) == (1.0, 40.0)


@pytest.mark.parametrize(
    ("frequencies", "densities", "message"),
    [
        ((1.0, 3.0, 2.0), (1.0, 1.0, 1.0), "goes from 3.0 to 2.0 Hz; its frequencies must rise"),
        ((1.0, 2.0, 2.0), (1.0, 1.0, 1.0), "its frequencies must rise"),
        ((1.0, np.nan, 2.0), (1.0, 1.0, 1.0), "its frequencies must rise"),
        ((0.0, 2.0), (1.0, 1.0), "it must begin above 0"),
        ((1.0, np.inf), (1.0, 1.0), "must begin above 0"),
        ((1.0, 2.0), (1.0, -1.0), "The PSD is -1.0 at 2.0 Hz"),
        ((1.0, 2.0), (0.0, 1.0), "The PSD is 0.0 at 1.0 Hz"),
        ((1.0, 2.0), (np.nan, 1.0), "The PSD is nan at 1.0 Hz"),
        ((1.0, 2.0), (1.0,), "2 frequencies and 1 densities"),
        ((1.0,), (1.0,), "two or more of each"),
        ((), (), "two or more of each"),
    ],
)
def test_a_table_that_is_none_is_refused(frequencies, densities, message):
    with pytest.raises(SettingError, match=message) as refusal:
        TabulatedSpectrum(frequencies=frequencies, densities=densities)
    assert refusal.value.field == "excitation.drive_spectra"


@pytest.mark.parametrize(("lowest", "highest"), [(0.0, 50.0), (-1.0, 50.0), (5.0, 5.0), (np.nan, 5.0), (1.0, np.inf)])
def test_a_band_that_is_none_is_refused(lowest, highest):
    with pytest.raises(SettingError, match="it must begin above 0 and end above its beginning") as refusal:
        White(lowest, highest)
    assert refusal.value.field == "excitation.spectrum.highest_frequency"


@pytest.mark.parametrize(
    ("corner", "slope", "field"),
    [(0.1, 3.0, "corner_frequency"), (np.nan, 3.0, "corner_frequency"), (5.0, -1.0, "decibels_per_octave")],
)
def test_a_white_pink_corner_or_slope_that_is_not_allowed_is_refused(corner, slope, field):
    with pytest.raises(SettingError) as refusal:
        WhitePink(lowest_frequency=1.0, highest_frequency=50.0, corner_frequency=corner, decibels_per_octave=slope)
    assert refusal.value.field == f"excitation.spectrum.{field}"
