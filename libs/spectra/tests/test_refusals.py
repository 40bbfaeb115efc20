"""Every function says what it does not take, with the value."""

import numpy as np
import pytest

import duralab_spectra

BLOCKS = {"block_samples": 256, "overlap": 0.5, "sample_rate": 1000.0}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: duralab_spectra.hop_samples(256, 0.999), "by less than one sample"),
        (lambda: duralab_spectra.independent_averages(np.ones(8), 0, 3), "The hop is 0"),
        (lambda: duralab_spectra.independent_averages(np.ones(8), 4, 0), "number of blocks 0"),
        (lambda: duralab_spectra.independent_averages(np.zeros(8), 4, 3), "zero everywhere"),
        (lambda: duralab_spectra.hann_periodic(1), "1 samples was asked for"),
        (lambda: duralab_spectra.line_frequencies(1, 10.0), "has 1 samples"),
        (lambda: duralab_spectra.line_frequencies(8, np.inf), "sample rate is inf"),
        (lambda: duralab_spectra.smooth_lines(np.ones(9), [1.0, 1.0]), "odd number of positive"),
        (lambda: duralab_spectra.smooth_lines(np.ones(9), [1.0, 0.0, 1.0]), "odd number of positive"),
        (lambda: duralab_spectra.smooth_lines(np.ones(4)), "4 lines cannot be smoothed with 5 weights"),
        (lambda: duralab_spectra.as_frf(np.ones((1, 2, 2))), "2 lines or more"),
        (lambda: duralab_spectra.as_frf(np.full((2, 1, 1), np.nan)), "at line 0, row 0, column 0"),
        (lambda: duralab_spectra.as_record([[1.0, np.inf]], name="drive"), "drive holds inf in channel 0 at sample 1"),
        (
            lambda: duralab_spectra.as_record(np.ma.masked_greater([[1.0, 2.0]], 1.5)),
            "samples has 1 masked values; fill them in",
        ),
        (lambda: duralab_spectra.paired_spectra(np.ones((2, 300)), np.ones((1, 300)), **BLOCKS), "2 and 1 channels"),
        (lambda: duralab_spectra.CrossSpectra(0, 1, **BLOCKS), "0 and 1 channels"),
        (lambda: duralab_spectra.CrossSpectra(1, 3, further=3, **BLOCKS), "3 further channels; allowed are 0 to 2"),
        (lambda: duralab_spectra.CrossSpectra(1, 3, further=-1, **BLOCKS), "-1 further channels; allowed are 0 to 2"),
        (lambda: duralab_spectra.CrossSpectra(1, 3, further=1, full=True, **BLOCKS), "none where S_aa is averaged"),
    ],
)
def test_what_is_not_allowed_is_refused_with_its_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
