import numpy as np
import pytest

from iterator import DriveLimitError, DriveLimits, require_within_limits
from iterator.limits import held_share

LIMITS = DriveLimits(
    names=("left_vertical", "left_lateral"),
    units=("m", "m"),
    minimum=np.array([-0.1, -0.05]),
    maximum=np.array([0.1, 0.05]),
    slew_limit=np.array([0.0, 2.0]),
    sample_rate=100.0,
)
GAIN = np.array([0.5, 0.8])


def check(drive, last_drive=None):
    require_within_limits(np.asarray(drive), last_drive=last_drive, limits=LIMITS, iteration_gain=GAIN)


def test_a_drive_on_its_limits_passes():
    check([[0.1, -0.1, 0.1, 0.0], [0.019, 0.038, 0.05, 0.031]])


def test_the_first_sample_counts_as_a_step_from_rest():
    with pytest.raises(DriveLimitError, match=r"left_lateral .* slew of 3 m/s"):
        check([[0.0, 0.0], [0.03, 0.03]])


def test_the_error_names_channel_peak_limit_and_the_gain_that_would_fit():
    with pytest.raises(DriveLimitError, match=r"left_vertical .* peak of -0\.4 m, .* limit of -0\.1 m") as caught:
        check([[0.0, -0.4, 0.2], [0.0, 0.0, 0.0]])
    assert caught.value.fitting_share == pytest.approx(0.25)
    np.testing.assert_allclose(caught.value.fitting_gain, 0.25 * GAIN)
    assert "0.25" in str(caught.value)


def test_the_slew_is_checked_where_a_limit_is_stated():
    with pytest.raises(DriveLimitError, match=r"left_lateral .* slew of 4 m/s, .* limit of 2 m/s"):
        check([[0.0, 0.1, -0.1], [0.0, 0.04, 0.04]])


@pytest.mark.parametrize("seed", range(5))
def test_the_drive_made_with_the_gain_that_would_fit_does_fit(seed):
    rng = np.random.default_rng(seed)
    last = rng.uniform(-0.02, 0.02, (2, 50)) * 0.4
    step = rng.normal(0.0, 0.1, (2, 50))
    with pytest.raises(DriveLimitError) as caught:
        check(last + step, last)
    share = caught.value.fitting_share
    check(last + 0.999999 * share * step, last)
    with pytest.raises(DriveLimitError):
        check(last + 1.001 * share * step, last)


def test_a_drive_that_was_at_its_limit_already_fits_with_no_gain():
    last = np.array([[0.1, 0.0], [0.0, 0.0]])
    with pytest.raises(DriveLimitError, match="smaller target"):
        check(last + 0.01, last)


def test_how_long_a_drive_stands_at_its_limits_is_told_over_all_channels():
    limits = DriveLimits(("a", "b"), ("m", "N"), np.array([-1.0, -10.0]), np.array([1.0, 10.0]), np.zeros(2), 100.0)
    drive = np.zeros((2, 100))
    assert held_share(drive, limits) == 0.0
    drive[0, :5], drive[1, 3:8], drive[1, 90] = 1.0, -9.9, 9.7
    assert held_share(drive, limits) == 0.08


def test_a_drive_without_limits_stands_at_none():
    free = DriveLimits(("a",), ("m",), np.array([-np.inf]), np.array([np.inf]), np.zeros(1), 100.0)
    assert held_share(np.ones((1, 9)), free) == 0.0
