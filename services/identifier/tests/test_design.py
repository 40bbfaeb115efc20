from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from short_experiments import MULTISINES, PINK, RATE, WHITE, blocks_of, drive_coherence, settings_of

from duralab_settings import ExcitationKind, TabulatedSpectrum
from identifier.excitation import crest_factors, design_experiment, power_density
from identifier.layout import Window

EXACT = [
    ExcitationKind.SWEPT_SINE,
    ExcitationKind.HADAMARD,
    ExcitationKind.ORTHOGONAL_DFT,
    ExcitationKind.RANDOM_ORTHOGONAL,
]


def design(drives=3, **changes):
    return design_experiment(settings_of(drives, **changes), drives=drives, sample_rate=RATE)


@pytest.mark.parametrize("kind", EXACT, ids=lambda kind: kind.value)
@pytest.mark.parametrize("drives", [1, 2, 3, 6, 8])
def test_orthogonal_drives_have_a_diagonal_s_uu_though_their_psds_differ(kind, drives):
    assert drive_coherence(design(drives, kind=kind, duration=60.0)) <= 1e-12


def test_nine_drives_take_the_twelve_columns_of_paley():
    experiment = design(9, kind=ExcitationKind.HADAMARD, duration=60.0, delay_blocks=1, capture_blocks=1)
    assert len(experiment.layout.captures) == 12
    assert drive_coherence(experiment) <= 1e-12


@pytest.mark.parametrize("kind", EXACT[1:], ids=lambda kind: kind.value)
def test_s_uu_stays_diagonal_with_phases_chosen_for_a_small_crest_factor(kind):
    assert drive_coherence(design(kind=kind, minimise_crest_factor=True)) <= 1e-12


def test_independent_phases_are_not_orthogonal():
    assert drive_coherence(design(kind=ExcitationKind.PSEUDO_RANDOM)) > 0.1


@pytest.mark.parametrize("kind", MULTISINES, ids=lambda kind: kind.value)
def test_the_psd_of_every_captured_block_of_a_multisine_is_exact(kind):
    table = TabulatedSpectrum(frequency=(0.5, 8.0, 50.0), density=(1.0, 30.0, 2.0))
    experiment = design(kind=kind, drive_spectra=(WHITE, PINK, table))
    lines = np.abs(np.fft.rfft(blocks_of(experiment), axis=-1)) ** 2
    frequency = experiment.layout.frequency
    for index, spectrum in enumerate((WHITE, PINK, table)):
        density = power_density(spectrum, frequency)
        # Parseval: twice the sum over the lines is block^2 times the mean square.
        expected = density / density.sum() * (0.5 + index) ** 2 * 2048**2 / 2.0
        np.testing.assert_allclose(lines[:, index], np.tile(expected, (len(lines), 1)), rtol=1e-9, atol=1e-18 * 2048**2)


@pytest.mark.parametrize("kind", list(ExcitationKind), ids=lambda kind: kind.value)
def test_the_rms_over_the_captures_is_exact(kind):
    experiment = design(kind=kind)
    layout = experiment.layout
    used = [experiment.drive[:, c.start : c.start + layout.samples_of(c)] for c in layout.captures]
    rms = np.sqrt(np.mean(np.concatenate(used, axis=1) ** 2, axis=1))
    np.testing.assert_allclose(rms, [0.5, 1.5, 2.5], rtol=1e-12)


@pytest.mark.parametrize("kind", list(ExcitationKind), ids=lambda kind: kind.value)
def test_the_peak_of_the_whole_drive_is_exact(kind):
    drive = design(kind=kind, level="peak").drive
    np.testing.assert_allclose(np.max(np.abs(drive), axis=1), [0.5, 1.5, 2.5], rtol=1e-12)


@pytest.mark.parametrize("kind", EXACT[1:], ids=lambda kind: kind.value)
def test_peak_levels_keep_s_uu_diagonal(kind):
    assert drive_coherence(design(kind=kind, level="peak")) <= 1e-12


@pytest.mark.parametrize("kind", list(ExcitationKind), ids=lambda kind: kind.value)
def test_a_rig_at_rest_is_not_kicked(kind):
    drive = design(kind=kind).drive
    np.testing.assert_array_equal(drive[:, [0, -1]], 0.0)
    step = np.max(np.abs(np.diff(drive, axis=1)), axis=1)
    # A tenth of the fades' slope (1/250 a sample) on top of the steepest that 50 Hz can be: no jump anywhere.
    steepest = 2.0 * np.pi * 50.0 / RATE * np.max(np.abs(drive), axis=1)
    assert np.all(step <= 1.1 * steepest)
    assert np.all(np.abs(drive[:, 1]) <= 1.1 * steepest / 250.0 + np.max(np.abs(drive), axis=1) / 250.0)


@pytest.mark.parametrize("kind", MULTISINES, ids=lambda kind: kind.value)
def test_a_capture_of_a_multisine_and_the_delay_behind_its_fade_repeat_every_block(kind):
    experiment = design(kind=kind, delay_blocks=2, capture_blocks=2, duration=60.0)
    for capture in experiment.layout.captures:
        stretch = experiment.drive[:, capture.start - 2 * 2048 : capture.start + 2 * 2048].reshape(3, 4, 2048)
        np.testing.assert_allclose(stretch[:, 1], stretch[:, 2], atol=1e-15)
        np.testing.assert_allclose(stretch[:, 2], stretch[:, 3], atol=1e-15)


@pytest.mark.parametrize("kind", MULTISINES, ids=lambda kind: kind.value)
def test_the_captures_of_a_linear_plant_give_its_exact_frf(kind):
    """The poles decay by 0.8 a sample: after a block of delay nothing is left of any experiment before."""
    experiment = design(2, kind=kind, duration=60.0)
    layout, cells = experiment.layout, [[[1.0, 0.5], [0.3]], [[-0.2, 0.1], [2.0, 0.0, 1.0]]]
    response = np.stack(
        [sum(signal.lfilter(b, [1.0, -0.8], experiment.drive[j]) for j, b in enumerate(row)) for row in cells]
    )
    true = np.array(
        [[signal.freqz(b, [1.0, -0.8], 2 * np.pi * layout.frequency / RATE)[1] for b in row] for row in cells]
    ).transpose(2, 0, 1)[layout.excited]
    played, measured = (
        np.fft.rfft(blocks_of(replace(experiment, drive=record)), axis=-1)[..., layout.excited].transpose(2, 1, 0)
        for record in (experiment.drive, response)
    )
    estimated = measured @ np.linalg.pinv(played)
    assert np.max(np.abs(estimated - true)) <= 1e-12 * np.max(np.abs(true))


def test_a_repeat_plays_the_same_realisation_again_and_the_next_realisation_is_another():
    experiment = design(repeats=2, realisations=2, duration=80.0)
    numbers = [(c.realisation, c.experiment) for c in experiment.layout.captures]
    assert numbers == [(m, c) for m in range(2) for _ in range(2) for c in range(3)]
    blocks = blocks_of(experiment)[::2]
    np.testing.assert_array_equal(blocks[:3], blocks[3:6])
    assert np.max(np.abs(blocks[:3] - blocks[6:9])) > 1.0


def test_an_odd_multisine_has_nothing_on_even_lines_and_on_detection_lines():
    experiment = design(odd_lines=True, detection_share=0.25, duration=60.0)
    layout = experiment.layout
    assert not layout.excited[::2].any()
    odd_detection = np.flatnonzero(layout.detection[1::2])
    excited = int(layout.excited.sum())
    assert 0.2 < odd_detection.size / (odd_detection.size + excited) < 0.3
    lines = np.abs(np.fft.rfft(blocks_of(experiment), axis=-1))
    largest = lines.max(axis=(0, 2))[None, :, None]
    assert np.max(lines[..., ~layout.excited] / largest) < 1e-13
    assert np.min(lines[..., layout.excited] / largest) > 0.01
    in_band = (layout.frequency >= 0.5) & (layout.frequency <= 50.0)
    np.testing.assert_array_equal(layout.excited | layout.detection, in_band)
    assert drive_coherence(experiment) <= 1e-12


def test_detection_lines_are_spread_evenly_and_follow_no_pattern():
    detection = np.flatnonzero(design(detection_share=0.2).layout.detection)
    gaps = np.diff(detection)
    assert gaps.max() < 10
    assert len(set(gaps.tolist())) > 3


@pytest.mark.parametrize("kind", list(ExcitationKind), ids=lambda kind: kind.value)
def test_the_same_settings_give_the_same_bytes_and_another_seed_others(kind):
    assert design(kind=kind).drive.tobytes() == design(kind=kind).drive.tobytes()
    # A sweep has nothing random.
    assert (design(kind=kind, seed=12).drive.tobytes() == design(kind=kind).drive.tobytes()) == (
        kind is ExcitationKind.SWEPT_SINE
    )


@pytest.mark.parametrize(
    "kind",
    [ExcitationKind.PURE_RANDOM, ExcitationKind.BURST_RANDOM, ExcitationKind.PSEUDO_RANDOM],
    ids=lambda kind: kind.value,
)
def test_an_independent_drive_does_not_depend_on_how_many_others_there_are(kind):
    np.testing.assert_array_equal(design(2, kind=kind).drive, design(4, kind=kind).drive[:2])


def test_pure_random_is_gaussian_and_a_burst_only_while_it_lasts():
    drive = design(kind=ExcitationKind.PURE_RANDOM, duration=200.0, drive_spectra=(WHITE,) * 3, fade=0.0).drive
    kurtosis = np.mean(drive**4, axis=1) / np.mean(drive**2, axis=1) ** 2
    np.testing.assert_allclose(kurtosis, 3.0, rtol=0.06)
    bursts = blocks_of(design(kind=ExcitationKind.BURST_RANDOM, burst_share=0.25))
    np.testing.assert_array_equal(bursts[..., 512:], 0.0)
    assert np.all(np.abs(bursts[..., 100:500]).max(axis=-1) > 0.0)


def test_a_sweep_spends_its_energy_as_the_psd_asks():
    experiment = design(
        1,
        kind=ExcitationKind.SWEPT_SINE,
        drive_spectra=(PINK,),
        block_samples=32768,
        burst_share=0.9,
        fade=0.05,
    )
    power = np.abs(np.fft.rfft(blocks_of(experiment)[0, 0])) ** 2
    frequency = experiment.layout.frequency

    def level(low, high):
        return 10 * np.log10(np.mean(power[(frequency >= low) & (frequency <= high)]))

    assert level(1.0, 2.0) == pytest.approx(level(3.0, 4.0), abs=0.7)
    assert level(8.0, 12.0) - level(32.0, 48.0) == pytest.approx(12.0, abs=0.7)
    assert level(60.0, 500.0) < level(32.0, 48.0) - 30.0
    assert crest_factors(blocks_of(experiment)[0, 0]) == pytest.approx(np.sqrt(2.0 / 0.9), rel=0.02)


def test_windows_and_captures_are_those_of_the_kind():
    random = design(kind=ExcitationKind.PURE_RANDOM).layout
    assert (random.window, random.periodic, random.overlap) == (Window.HANN, False, 0.5)
    assert random.samples_of(random.captures[0]) == 40_000 - 500
    burst = design(kind=ExcitationKind.BURST_RANDOM).layout
    assert (burst.window, burst.periodic, burst.overlap) == (Window.NONE, False, 0.0)
    assert [c.realisation for c in burst.captures] == list(range(19))
    sweep = design(kind=ExcitationKind.SWEPT_SINE).layout
    assert [c.experiment for c in sweep.captures] == [0, 1, 2, 3] * 4
    multisine = design().layout
    assert (multisine.window, multisine.periodic, multisine.delay_blocks) == (Window.NONE, True, 1)


def test_the_drive_cannot_be_changed_by_accident():
    with pytest.raises(ValueError, match="read-only"):
        design().drive[0, 0] = 1.0
