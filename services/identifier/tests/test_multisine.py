import numpy as np
import pytest

from duralab_settings import TabulatedSpectrum
from identifier.excitation import white
from identifier.excitation.multisine import block_of, choose_lines, line_amplitudes

FREQUENCY = np.arange(129.0)


def test_a_block_is_the_sum_of_cosines_of_its_lines():
    lines = np.zeros(129, dtype=complex)
    lines[3], lines[40] = 2.0 * np.exp(0.7j), 0.5 * np.exp(-2.0j)
    time = np.arange(256) / 256.0
    expected = 2.0 * np.cos(2 * np.pi * 3 * time + 0.7) + 0.5 * np.cos(2 * np.pi * 40 * time - 2.0)
    np.testing.assert_allclose(block_of(lines, 256), expected, atol=1e-14)


def test_amplitudes_are_those_of_a_block_of_rms_one_whatever_the_phases():
    spectra = (white(2.0, 60.0), TabulatedSpectrum(frequency=(2.0, 60.0), density=(9.0, 1.0)))
    excited, _ = choose_lines(spectra[0], frequency=FREQUENCY, odd=True, detection_share=0.0, seed=1)
    amplitude = line_amplitudes(spectra, frequency=FREQUENCY, excited=excited)
    phase = np.exp(2j * np.pi * np.random.default_rng(2).random(amplitude.shape))
    rms = np.sqrt(np.mean(block_of(amplitude * phase, 256) ** 2, axis=1))
    np.testing.assert_allclose(rms, 1.0, rtol=1e-13)


@pytest.mark.parametrize("odd", [False, True])
def test_lines_without_a_phase_are_not_excited(odd):
    excited, detection = choose_lines(white(1e-9, 128.0), frequency=FREQUENCY, odd=odd, detection_share=0.0, seed=1)
    assert not (excited | detection)[[0, 128]].any()
    np.testing.assert_array_equal(np.flatnonzero(detection), np.arange(2, 128, 2) if odd else [])
