import numpy as np
import pytest

from iterator import unreachable_segments

RATE = 200.0


def test_an_error_where_a_drive_was_held_is_unreachable_and_one_elsewhere_is_not():
    target = np.random.default_rng(3).standard_normal((2, 8000))
    response = 0.95 * target
    response[0, 2000:2600] = 0.2 * target[0, 2000:2600]
    response[1, 6000:6600] = 0.2 * target[1, 6000:6600]
    saturated = np.zeros((3, 8000), dtype=bool)
    saturated[2, 2000:2600:7] = True
    (found,) = unreachable_segments(target, response, saturated=saturated, sample_rate=RATE)
    assert found.response == 0
    assert (found.segment.start, found.segment.end) == pytest.approx((10.0, 13.0), abs=0.6)
    assert found.relative_rms_error == pytest.approx(0.8, abs=0.12)


def test_a_held_drive_that_costs_no_error_is_not_flagged():
    target = np.random.default_rng(4).standard_normal((1, 4000))
    saturated = np.zeros((1, 4000), dtype=bool)
    assert unreachable_segments(target, 0.9 * target, saturated=saturated, sample_rate=RATE) == ()
    saturated[0, 1000:1100] = True
    assert unreachable_segments(target, 0.9 * target, saturated=saturated, sample_rate=RATE) == ()
