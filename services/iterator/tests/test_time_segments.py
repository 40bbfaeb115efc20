import numpy as np

from iterator import Segment, segments_of


def holding(*samples):
    holds = np.zeros(1000, dtype=bool)
    holds[list(samples)] = True
    return holds


def test_what_is_less_than_the_gap_apart_is_one_stretch():
    holds = holding(0, 1, 40, 91, 999)
    # Between samples 40 and 91 lie 50 samples, half a second.
    assert segments_of(holds, sample_rate=100.0) == (Segment(0.0, 0.41), Segment(0.91, 0.92), Segment(9.99, 10.0))


def test_neighbouring_samples_are_one_stretch_without_any_gap():
    assert segments_of(holding(3, 4, 6), sample_rate=1.0, largest_gap=0.0) == (Segment(3.0, 5.0), Segment(6.0, 7.0))


def test_what_never_holds_has_no_stretch():
    assert segments_of(holding(), sample_rate=100.0) == ()
