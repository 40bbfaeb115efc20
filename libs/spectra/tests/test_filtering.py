import numpy as np
import pytest

import duralab_spectra

RATE = 1000.0


def smooth_frf(generator, *, block=512, n_out=3, n_in=2):
    matrix = generator.standard_normal((block // 2 + 1, n_out, n_in)) * (1.0 + 1j)
    mask = duralab_spectra.band_mask(duralab_spectra.line_frequencies(block, RATE), 5.0, 300.0, edge=4.0)
    return matrix * mask[:, None, None]


def direct_convolution(record, impulse):
    half = impulse.shape[-1] // 2
    return np.stack(
        [
            sum(np.convolve(record[j], impulse[i, j])[half : half + record.shape[1]] for j in range(record.shape[0]))
            for i in range(impulse.shape[0])
        ]
    )


@pytest.mark.parametrize("samples", [1, 7, 511, 512, 9999, 20_001])
@pytest.mark.parametrize("transform", [None, 600, 1024])
def test_overlap_save_equals_the_whole_record(samples, transform):
    generator = np.random.default_rng(samples)
    frf = smooth_frf(generator)
    record = generator.standard_normal((2, samples))
    whole = duralab_spectra.filter_whole_record(record, frf)
    pieces = duralab_spectra.overlap_save(record, frf, transform_samples=transform)
    assert pieces.shape == (3, samples)
    # Relative to what full overlap of record and impulse response can give: short records hardly meet it.
    scale = np.max(np.abs(record)) * np.max(np.sum(np.abs(duralab_spectra.centred_impulse_response(frf)), axis=-1))
    assert np.max(np.abs(pieces - whole)) <= 1e-12 * np.max(np.abs(whole)) + 1e-15 * scale


def test_filtering_is_the_linear_convolution_with_the_centred_impulse_response():
    generator = np.random.default_rng(3)
    frf = smooth_frf(generator)
    record = generator.standard_normal((2, 1777))
    expected = direct_convolution(record, duralab_spectra.centred_impulse_response(frf))
    np.testing.assert_allclose(
        duralab_spectra.filter_whole_record(record, frf), expected, atol=1e-12 * np.abs(expected).max()
    )


def test_nothing_wraps_around():
    frf = smooth_frf(np.random.default_rng(4))
    record = np.zeros((2, 4001))
    record[:, -1] = 1.0
    for filtered in (duralab_spectra.filter_whole_record(record, frf), duralab_spectra.overlap_save(record, frf)):
        assert np.max(np.abs(filtered[:, : -512 // 2 - 1])) <= 1e-13
        assert np.max(np.abs(filtered[:, -256:])) > 1e-3


@pytest.mark.parametrize("delay", [-40, 0, 25])
def test_an_advance_is_as_good_as_a_delay(delay):
    frequency = duralab_spectra.line_frequencies(256, RATE)
    frf = np.exp(-2j * np.pi * frequency * delay / RATE)[:, None, None]
    record = np.random.default_rng(6).standard_normal((1, 3000))
    expected = np.zeros_like(record)
    expected[:, max(0, delay) : 3000 + min(0, delay)] = record[:, max(0, -delay) : 3000 - max(0, delay)]
    np.testing.assert_allclose(duralab_spectra.overlap_save(record, frf), expected, atol=1e-13)


def test_a_real_frf_has_a_symmetric_impulse_response():
    frf = np.random.default_rng(7).standard_normal((129, 1, 1))
    response = duralab_spectra.centred_impulse_response(frf)
    np.testing.assert_allclose(response, response[..., ::-1], atol=1e-15)


def test_a_record_of_other_channels_is_refused():
    with pytest.raises(ValueError, match="3 channels and the FRF takes 2"):
        duralab_spectra.overlap_save(np.ones((3, 10)), np.ones((5, 2, 2)))
    with pytest.raises(ValueError, match="longer than the FRF's block of 8"):
        duralab_spectra.overlap_save(np.ones((2, 10)), np.ones((5, 2, 2)), transform_samples=8)
