"""Records, blocks, cross-spectra, inverse filtering and metrics: numpy and scipy only, no input or output.

Records are (channels, samples) with time along the last axis; spectra are (lines, channels); an FRF is
(lines, responses, drives) and follows ``e^{+j omega t}``. Everything is float64 or complex128, C-contiguous, in SI
units.
"""

from duralab_spectra.band import band_mask
from duralab_spectra.block_spectra import NotFiniteError
from duralab_spectra.blocks import count_blocks, hop_samples, independent_averages
from duralab_spectra.filtering import centred_impulse_response, filter_whole_record, overlap_save
from duralab_spectra.inverse import LARGEST_CONDITION, as_frf, inverse_frf, pseudo_inverse
from duralab_spectra.lines import line_frequencies, smooth_lines
from duralab_spectra.metrics import (
    crest_factor,
    overall_relative_rms_error,
    peak_ratio,
    relative_rms_error,
    rms,
    rms_response,
)
from duralab_spectra.noise_floor import noise_floor
from duralab_spectra.records import as_record, require_sample_rate, shaped_record
from duralab_spectra.running_spectra import CrossSpectra, SpectraEstimate
from duralab_spectra.static_part import dynamic_part, static_levels
from duralab_spectra.thinning import drawn_points, piece_extremes
from duralab_spectra.welch import auto_spectra, cross_spectra, paired_spectra
from duralab_spectra.windows import hann_periodic

__all__ = [
    "LARGEST_CONDITION",
    "CrossSpectra",
    "NotFiniteError",
    "SpectraEstimate",
    "as_frf",
    "as_record",
    "auto_spectra",
    "band_mask",
    "centred_impulse_response",
    "count_blocks",
    "crest_factor",
    "cross_spectra",
    "drawn_points",
    "dynamic_part",
    "filter_whole_record",
    "hann_periodic",
    "hop_samples",
    "independent_averages",
    "inverse_frf",
    "line_frequencies",
    "noise_floor",
    "overall_relative_rms_error",
    "overlap_save",
    "paired_spectra",
    "peak_ratio",
    "piece_extremes",
    "pseudo_inverse",
    "relative_rms_error",
    "require_sample_rate",
    "rms",
    "rms_response",
    "shaped_record",
    "smooth_lines",
    "static_levels",
]
