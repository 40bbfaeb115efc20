"""Cases in which other tools of the field were found to go wrong, with what they do where it can be shown."""

import numpy as np
import pytest

import duralab_spectra

RATE = 512.0
BLOCK = 128


def density(record, *, overlap=0.5):
    return duralab_spectra.auto_spectra(record, block_samples=BLOCK, overlap=overlap, sample_rate=RATE)


def time_response_assurance(target, response):
    """Squared cosine between two signals: a customary measure of how alike two time histories are."""
    return np.sum(target * response, axis=1) ** 2 / (np.sum(target**2, axis=1) * np.sum(response**2, axis=1))


def test_a_constant_and_the_highest_frequency_keep_their_power_in_a_one_sided_spectrum():
    """Doubling every line doubles the mean and the Nyquist line too, which have no negative twin."""
    time = np.arange(10 * BLOCK)
    parts = [np.full(time.size, 3.0), 0.5 * (-1.0) ** time, 2.0 * np.cos(2.0 * np.pi * 20.0 * time / BLOCK)]
    total = np.sum(density(np.array(parts)), axis=0) * RATE / BLOCK
    np.testing.assert_allclose(total, [9.0, 0.25, 2.0], rtol=1e-12)


def test_what_does_not_fill_a_block_does_not_lower_the_level():
    """Filling the last block up with zeros, and counting it, lowers the spectrum of every record of an odd length."""
    tone = np.cos(2.0 * np.pi * 20.0 * np.arange(5 * BLOCK // 2 + 1) / BLOCK)[None, :]
    np.testing.assert_allclose(density(tone, overlap=0.0), density(tone[:, : 2 * BLOCK], overlap=0.0), atol=1e-15)


def test_a_static_load_does_not_leak_into_the_dynamics():
    """Under a symmetric Hann window, the usual default, a constant leaks into every line."""
    time = np.arange(4 * BLOCK)
    tone = 1e-3 * np.cos(2.0 * np.pi * 20.0 * time / BLOCK)
    loaded, plain = density(np.array([tone + 4000.0, tone])).T
    np.testing.assert_allclose(loaded[2:], plain[2:], atol=1e-6 * plain.max())
    symmetric = np.hanning(BLOCK)
    leaked = 2.0 * np.abs(np.fft.rfft(4000.0 * symmetric)[3:]) ** 2 / (RATE * symmetric @ symmetric)
    assert leaked.max() > 100.0 * plain.max()


def test_the_cross_spectrum_of_b_with_a_is_the_adjoint():
    """Where the first argument is conjugated, as often, a delay comes out as an advance."""
    a, b = np.random.default_rng(1).standard_normal((2, 3, 2000))
    chosen = {"block_samples": BLOCK, "overlap": 0.5, "sample_rate": RATE}
    forward, backward = duralab_spectra.cross_spectra(a, b, **chosen), duralab_spectra.cross_spectra(b[:2], a, **chosen)
    np.testing.assert_allclose(forward[:, :, :2], backward.conj().transpose(0, 2, 1), atol=1e-14)


@pytest.mark.parametrize(("scale", "error", "level"), [(0.5, 0.5, 0.5), (2.0, 1.0, 2.0), (-1.0, 2.0, 1.0)])
def test_a_response_of_the_right_shape_at_the_wrong_level_is_not_taken_for_good(scale, error, level):
    """A squared cosine between target and response is 1 at every scale, and at the wrong sign."""
    target = np.random.default_rng(2).standard_normal((2, 501))
    np.testing.assert_allclose(time_response_assurance(target, scale * target), 1.0, rtol=1e-12)
    np.testing.assert_allclose(duralab_spectra.relative_rms_error(target, scale * target), error, rtol=1e-12)
    np.testing.assert_allclose(duralab_spectra.rms_response(target, scale * target), level, rtol=1e-12)


def test_a_late_response_is_an_error():
    """Shifting a response to where it fits best, before it is compared, hides the delay that a phase error is."""
    angle = 2.0 * np.pi * 8.0 * np.arange(BLOCK) / BLOCK
    late = 2.0 * np.pi * 8.0 * 3 / BLOCK
    found = duralab_spectra.relative_rms_error(np.sin(angle)[None, :], np.sin(angle - late)[None, :])
    assert found[0] == pytest.approx(2.0 * np.sin(late / 2.0), rel=1e-12)


def test_the_end_of_a_record_does_not_come_back_at_its_start():
    """A product of spectra on the record's own length is a circular convolution: the end wraps around to the start."""
    delay, samples = 20, 501
    frequency = duralab_spectra.line_frequencies(BLOCK, RATE)
    frf = np.exp(-2j * np.pi * frequency * delay / RATE)[:, None, None]
    record = np.zeros((1, samples))
    record[0, -5] = 1.0
    lines = np.exp(-2j * np.pi * np.fft.rfftfreq(samples) * delay)
    assert np.abs(np.fft.irfft(np.fft.rfft(record) * lines, samples)[0, delay - 5]) > 0.9
    for filtered in (duralab_spectra.filter_whole_record(record, frf), duralab_spectra.overlap_save(record, frf)):
        assert np.max(np.abs(filtered[:, : samples // 2])) <= 1e-14


@pytest.mark.parametrize("samples", [1, 2, 3, 127, 501, 1000])
def test_a_record_of_any_length_comes_back_whole(samples):
    """An inverse transform that is not told its length makes an even one: odd records lose their last sample."""
    record = np.random.default_rng(3).standard_normal((2, samples))
    same = np.broadcast_to(np.eye(2), (BLOCK // 2 + 1, 2, 2))
    for filtered in (duralab_spectra.filter_whole_record(record, same), duralab_spectra.overlap_save(record, same)):
        np.testing.assert_allclose(filtered, record, atol=1e-14)


@pytest.mark.parametrize("size", [1e-15, 1e-9, 1e9])
def test_small_numbers_are_inverted_as_well_as_large_ones(size):
    """A fixed small number added to a denominator, or a fixed threshold, eats compliances in metres per newton."""
    generator = np.random.default_rng(4)
    frf = generator.standard_normal((5, 3, 3)) + 1j * generator.standard_normal((5, 3, 3))
    chosen = {"mask": np.ones(5), "frequency": np.arange(5.0)}
    small = duralab_spectra.inverse_frf(size * frf, **chosen)
    np.testing.assert_allclose(size * small, duralab_spectra.inverse_frf(frf, **chosen), rtol=1e-10)


def test_a_moment_beside_a_force_is_not_taken_for_noise():
    """A pseudo-inverse that drops singular values below a share of the largest drops the channel of the small unit."""
    frf = np.broadcast_to(np.diag([1e6, 1e-4]).astype(complex), (3, 2, 2))
    inverse = duralab_spectra.inverse_frf(frf, mask=np.ones(3), frequency=np.arange(3.0))
    np.testing.assert_allclose(inverse[1], np.diag([1e-6, 1e4]), rtol=1e-12)
    assert np.linalg.pinv(frf[1], rcond=1e-6)[1, 1] == 0.0


def test_noise_alone_is_not_coherent_because_it_was_averaged_seldom():
    """From one block the coherence is 1 whatever was measured; the number of blocks is told with every estimate."""
    noise = np.random.default_rng(5).standard_normal((2, BLOCK))
    running = duralab_spectra.CrossSpectra(1, 1, block_samples=BLOCK, overlap=0.0, sample_rate=RATE)
    running.add(noise[:1], noise[1:])
    found = running.estimate()
    coherence = np.abs(found.s_ab[:, 0, 0]) ** 2 / (found.auto_a[:, 0] * found.s_bb[:, 0, 0].real)
    np.testing.assert_allclose(coherence, 1.0, rtol=1e-9)
    assert found.blocks == 1
    assert found.independent_averages == 1.0


def test_overlapping_blocks_do_not_count_as_independent_ones():
    """Counted as independent, blocks that overlap much make the random error look far too small."""
    record = np.random.default_rng(6).standard_normal((1, 64 * BLOCK))
    estimates = []
    for overlap in (0.5, 0.9375):
        running = duralab_spectra.CrossSpectra(1, 1, block_samples=BLOCK, overlap=overlap, sample_rate=RATE)
        running.add(record, record)
        estimates.append(running.estimate())
    half, most = estimates
    assert most.blocks > 7.9 * half.blocks
    assert most.independent_averages < 1.2 * half.independent_averages
    # The spread of a density over the lines is one over the root of what is independent.
    spread = np.std(most.auto_a[2:-2]) / np.mean(most.auto_a[2:-2])
    assert spread == pytest.approx(most.independent_averages**-0.5, rel=0.25)
    assert spread > 2.0 * most.blocks**-0.5
