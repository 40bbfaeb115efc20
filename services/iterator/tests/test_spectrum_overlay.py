import numpy as np

from iterator import overlay_spectra

RATE = 200.0


def test_the_overlay_shows_level_and_coherence_line_by_line():
    rng = np.random.default_rng(2)
    target = rng.standard_normal((1, 20000))
    noise = rng.standard_normal((1, 20000))
    response = 0.5 * target + 0.5 * noise
    overlay = overlay_spectra(target, response, sample_rate=RATE, block_samples=256)
    inner = slice(5, -5)
    np.testing.assert_allclose(overlay.target[inner].mean(), 2.0 / RATE, rtol=0.03)
    np.testing.assert_allclose((overlay.response / overlay.target)[inner].mean(), 0.5, rtol=0.05)
    np.testing.assert_allclose(overlay.coherence[inner].mean(), 0.5, atol=0.03)
    np.testing.assert_allclose(overlay.error[inner].mean(), 0.5 * 2.0 / RATE, rtol=0.05)
