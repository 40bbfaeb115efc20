import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

import duralab_spectra


def test_hann_is_the_periodic_one():
    np.testing.assert_allclose(
        duralab_spectra.hann_periodic(256), signal.get_window("hann", 256, fftbins=True), atol=1e-15
    )


def test_half_overlapped_hann_windows_add_up_to_a_constant():
    window = duralab_spectra.hann_periodic(512)
    np.testing.assert_allclose(window[:256] + window[256:], 1.0, rtol=1e-15)


@settings(max_examples=60)
@given(st.integers(0, 3000), st.integers(1, 150), st.sampled_from([0.0, 0.25, 0.5, 0.6, 2.0 / 3.0, 0.75, 0.9]))
def test_eq_10_counts_the_blocks_that_are_actually_cut(samples, half_block, overlap):
    block = 2 * half_block
    if round(block * (1 - overlap)) < 1:
        return
    hop = duralab_spectra.hop_samples(block, overlap)
    cut = [start for start in range(0, samples, hop) if start + block <= samples]
    assert duralab_spectra.count_blocks(samples, block, overlap) == len(cut)
    if samples >= block:
        accumulator = duralab_spectra.CrossSpectra(1, 1, block_samples=block, overlap=overlap, sample_rate=1.0)
        record = np.ones((1, samples))
        accumulator.add(record, record)
        assert accumulator.blocks == len(cut)


def test_eq_10_of_the_paper_in_seconds():
    assert duralab_spectra.count_blocks(600_000, 2048, 0.5) == int((600.0 - 2.048) // (2.048 * 0.5)) + 1


def test_blocks_without_overlap_are_all_independent():
    assert duralab_spectra.independent_averages(duralab_spectra.hann_periodic(128), 128, 40) == 40.0


def test_half_overlap_of_hann_gives_welchs_known_share():
    # Welch 1967: rho_1 = (1/6)^2 for Hann at half overlap.
    blocks = 200
    expected = blocks / (1 + 2 * (1 - 1 / blocks) / 36)
    assert duralab_spectra.independent_averages(duralab_spectra.hann_periodic(4096), 2048, blocks) == pytest.approx(
        expected, rel=1e-12
    )


@pytest.mark.parametrize(("block", "overlap"), [(255, 0.5), (0, 0.5), (256, 1.0), (256, -0.1), (256, float("nan"))])
def test_impossible_blocks_are_refused(block, overlap):
    with pytest.raises(ValueError, match="must be"):
        duralab_spectra.count_blocks(1000, block, overlap)


def test_smoothing_keeps_a_constant_and_the_mean_of_an_inner_peak():
    np.testing.assert_allclose(duralab_spectra.smooth_lines(np.full((20, 3), 2.0 + 1j)), 2.0 + 1j, rtol=1e-15)
    peak = np.zeros((11, 1))
    peak[5] = 9.0
    np.testing.assert_allclose(duralab_spectra.smooth_lines(peak)[3:8, 0], [1.0, 2.0, 3.0, 2.0, 1.0], rtol=1e-15)


def test_five_lines_are_smoothed_with_five_weights():
    np.testing.assert_allclose(
        duralab_spectra.smooth_lines(np.eye(5)[2]), [1 / 6, 2 / 8, 3 / 9, 2 / 8, 1 / 6], rtol=1e-12
    )


def test_the_hop_is_the_nearest_whole_number_of_samples():
    assert duralab_spectra.hop_samples(100, 0.994) == 1
    assert duralab_spectra.hop_samples(2, 0.0) == 2
