import numpy as np
import pytest
from short_experiments import MULTISINES, PINK, RATE, WHITE, blocks_of, settings_of

from duralab_settings import ExcitationKind
from identifier.excitation import crest_factors, design_experiment


def worst(drives, **changes):
    settings = settings_of(drives, realisations=1 if drives == 1 else None, **changes)
    return np.max(crest_factors(blocks_of(design_experiment(settings, drives=drives, sample_rate=RATE))))


def test_a_sine_has_the_root_of_two_and_a_square_wave_one():
    sine = np.sin(2 * np.pi * np.arange(1000) / 1000)
    np.testing.assert_allclose(crest_factors(np.stack([sine, np.sign(sine + 1e-9)])), [np.sqrt(2.0), 1.0], rtol=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_a_flat_multisine_comes_below_one_and_a_half(seed):
    assert worst(1, drive_spectra=(WHITE,), minimise_crest_factor=True, seed=seed) < 1.5


def test_an_odd_multisine_comes_below_one_point_seven():
    assert worst(1, drive_spectra=(WHITE,), minimise_crest_factor=True, odd_lines=True, detection_share=0.25) < 1.7


@pytest.mark.parametrize("spectrum", [WHITE, PINK], ids=["white", "white_pink"])
@pytest.mark.parametrize("kind", MULTISINES, ids=lambda kind: kind.value)
def test_the_worst_drive_of_a_set_of_six_gains_at_least_a_quarter(kind, spectrum):
    asked = {"kind": kind, "drive_spectra": (spectrum,) * 6, "duration": 70.0}
    assert worst(6, **asked, minimise_crest_factor=True) < 0.75 * worst(6, **asked)


def test_the_psd_is_not_touched():
    asked = {"kind": ExcitationKind.RANDOM_ORTHOGONAL, "realisations": 1}
    lines = [
        np.abs(
            np.fft.rfft(
                blocks_of(design_experiment(settings_of(**asked, minimise_crest_factor=m), drives=3, sample_rate=RATE))
            )
        )
        for m in (False, True)
    ]
    np.testing.assert_allclose(lines[0], lines[1], atol=1e-9)
