from dataclasses import replace

import numpy as np
import pytest

from identifier.layout import Capture, Layout, Window

EXCITED = np.zeros(129, dtype=bool)
EXCITED[2:20] = True
PERIODIC = Layout(
    samples=2000,
    sample_rate=256.0,
    block_samples=256,
    fade_samples=100,
    overlap=0.0,
    periodic=True,
    delay_blocks=1,
    captures=(Capture(256, 2, 0, 0), Capture(1024, 3, 0, 1)),
    lowest=2.0,
    highest=20.0,
    excited=EXCITED,
    detection=np.zeros(129, dtype=bool),
    window=Window.NONE,
)


def test_a_capture_without_a_window_is_its_whole_blocks():
    assert [PERIODIC.samples_of(capture) for capture in PERIODIC.captures] == [512, 768]


def test_a_capture_under_a_window_goes_on_to_the_next_one_or_to_the_last_fade():
    layout = replace(PERIODIC, periodic=False, window=Window.HANN, overlap=0.5)
    assert [layout.samples_of(capture) for capture in layout.captures] == [768, 876]


def test_the_lines_are_those_of_the_block():
    np.testing.assert_array_equal(PERIODIC.frequency, np.arange(129.0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sample_rate": np.nan}, "sample rate is nan"),
        ({"block_samples": 255}, "must be even"),
        ({"fade_samples": -1}, "none may be below 0"),
        ({"overlap": 0.5}, "do not overlap"),
        ({"window": Window.HANN}, "without a window"),
        ({"excited": EXCITED[:-1]}, "excited lines have shape"),
        ({"excited": ~EXCITED & False}, "No line is excited"),
        ({"highest": 18.0}, "must lie from 2 to 18 Hz"),
        ({"detection": EXCITED}, "be one or the other"),
        ({"captures": ()}, "no capture"),
        ({"captures": PERIODIC.captures[::-1]}, "must begin after the one before"),
        ({"samples": 1700}, "end within 1700 samples"),
        ({"periodic": False, "window": Window.HANN, "captures": (Capture(0, 8, 0, 0),)}, "does not hold 8 blocks"),
    ],
)
def test_a_layout_that_contradicts_itself_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(PERIODIC, **changes)


@pytest.mark.parametrize("numbers", [(-1, 1, 0, 0), (0, 0, 0, 0), (0, 1, -1, 0), (0, 1, 0, -1)])
def test_a_capture_without_a_period_or_with_a_number_below_zero_is_refused(numbers):
    with pytest.raises(ValueError, match="it must have a period and no number below 0"):
        Capture(*numbers)
