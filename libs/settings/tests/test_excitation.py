"""What an excitation and an estimator may be, whatever the rig; and an excitation for the drives of one rig."""

import numpy as np
import pytest
from pydantic import ValidationError

from duralab_settings import (
    EstimatorSettings,
    ExcitationKind,
    ExcitationSettings,
    LevelKind,
    ResolvedExcitation,
    SettingsError,
    TabulatedSpectrum,
    WhitePinkSpectrum,
    explained,
)

PINK = {"lowest_frequency": 0.5, "highest_frequency": 50.0, "corner_frequency": 5.0, "decibels_per_octave": 6.0}
WRITTEN = {**PINK, "duration": 40.0, "fade": 0.25, "rms": 0.01}
RESOLVED = {"spectrum": WhitePinkSpectrum(**PINK), "rms": (1.0, 1.0, 1.0), "duration": 40.0, "fade": 0.25, "seed": 11}
ESTIMATOR = {"block_samples": 2048}
RANDOM, SWEEP = ExcitationKind.PURE_RANDOM, ExcitationKind.SWEPT_SINE


def refused(model, values, *, prefix):
    with pytest.raises(ValidationError) as caught:
        model.model_validate(values)
    return explained(caught.value, model, prefix=prefix)


OTHER = WhitePinkSpectrum(**{**PINK, "lowest_frequency": 1.0})


@pytest.mark.parametrize(
    ("changes", "field", "sentence"),
    [
        ({"rms": (1.0, 0.0, 1.0)}, "rms.1", "excitation.rms.1 is 0.0; it must be greater than 0 (RMS of each drive"),
        ({"rms": (1.0, 1e308, 1.0)}, "rms.1", "it must be less than or equal to 1000000000000"),
        ({"rms": (1.0, np.nan, 1.0)}, "rms.1", "excitation.rms.1 is nan; it must be a finite number"),
        ({"rms": None, "peak": (1.0, 1.0, -1.0)}, "peak.2", "excitation.peak.2 is -1.0; it must be greater than 0"),
        ({"peak": (1.0, 1.0, 1.0)}, "peak", "needs an rms or a peak for its drives, and not both"),
        ({"rms": None}, "rms", "needs an rms or a peak for its drives, and not both"),
        ({"rms": ()}, "rms", "at least 1 item"),
        ({"drive_spectra": (OTHER,) * 3}, "drive_spectra", "needs one spectrum for all drives or drive_spectra"),
        ({"spectrum": None}, "drive_spectra", "needs one spectrum for all drives or drive_spectra"),
        ({"spectrum": None, "drive_spectra": (OTHER,) * 2}, "drive_spectra", "has 2 spectra and 3 levels"),
        (
            {"spectrum": None, "drive_spectra": (WhitePinkSpectrum(**PINK),) * 2 + (OTHER,)},
            "drive_spectra",
            "has a PSD of drive 2 that spans 1 to 50 Hz, that of drive 0 0.5 to 50 Hz",
        ),
        ({"duration": np.nan}, "duration", "excitation.duration is nan; it must be a finite number"),
        ({"duration": 0.0}, "duration", "excitation.duration is 0.0; it must be greater than 0"),
        ({"duration": np.inf}, "duration", "excitation.duration is inf; it must be a finite number"),
        ({"fade": -0.1}, "fade", "excitation.fade is -0.1; it must be greater than or equal to 0"),
        ({"fade": 20.0}, "fade", "excitation has fades of 20 s in 40 s; nothing would be left"),
        ({"seed": -1}, "seed", "excitation.seed is -1; it must be greater than or equal to 0"),
        ({"seed": 1.5}, "seed", "excitation.seed is 1.5; it must be a valid integer"),
        ({"seed": 2**64}, "seed", "it must be less than 18446744073709551616"),
        ({"delay_blocks": 0}, "delay_blocks", "excitation.delay_blocks is 0; it must be greater than or equal to 1"),
        ({"delay_blocks": 1.5}, "delay_blocks", "excitation.delay_blocks is 1.5; it must be a valid integer"),
        ({"capture_blocks": 0}, "capture_blocks", "excitation.capture_blocks is 0"),
        ({"repeats": -1}, "repeats", "excitation.repeats is -1"),
        ({"repeats": -1, "kind": RANDOM}, "repeats", "excitation.repeats is -1"),
        ({"realisations": 0}, "realisations", "excitation.realisations is 0"),
        ({"realisations": True}, "realisations", "excitation.realisations is True; it must be a valid integer"),
        ({"burst_share": 0.0}, "burst_share", "excitation.burst_share is 0.0; it must be greater than 0"),
        ({"detection_share": 0.6}, "detection_share", "it must be less than or equal to 0.5"),
        ({"detection_share": np.nan}, "detection_share", "excitation.detection_share is nan"),
        (
            {"odd_lines": True, "kind": RANDOM},
            "odd_lines",
            "excitation has odd_lines set for pure_random; only a multi",
        ),
        ({"minimise_crest_factor": True, "kind": SWEEP}, "minimise_crest_factor", "set for swept_sine"),
    ],
)
def test_an_excitation_that_no_rig_can_play_is_refused(changes, field, sentence):
    error = refused(ResolvedExcitation, RESOLVED | changes, prefix="excitation")

    assert sentence in str(error)
    assert error.field == f"excitation.{field}"


@pytest.mark.parametrize(
    ("changes", "field", "sentence"),
    [
        ({"block_samples": 2047}, "block_samples", "block_samples is 2047; it must be a multiple of 2"),
        ({"block_samples": 2048.5}, "block_samples", "block_samples is 2048.5; it must be a valid integer"),
        ({"block_samples": 128}, "block_samples", "block_samples is 128; it must be greater than or equal to 256"),
        (
            {"block_samples": 2**21},
            "block_samples",
            "block_samples is 2097152; it must be less than or equal to 1048576",
        ),
        ({"overlap": 1.0}, "overlap", "overlap is 1.0; it must be less than 1"),
        ({"overlap": np.nan}, "overlap", "overlap is nan; it must be a finite number"),
        ({"local_order": 7}, "local_order", "local_order is 7; it must be less than or equal to 6"),
        ({"local_half_width": 0}, "local_half_width", "local_half_width is 0; it must be greater than or equal to 1"),
        ({"kind": "h3"}, "kind", "kind is 'h3'; allowed: 'h1', 'h2', 'hv', 'local_polynomial', 'local_rational'"),
    ],
)
def test_an_estimator_that_cannot_be_is_refused(changes, field, sentence):
    error = refused(EstimatorSettings, ESTIMATOR | changes, prefix="estimator")

    assert f"estimator.{sentence}" in str(error)
    assert error.field == f"estimator.{field}"


@pytest.mark.parametrize(
    ("frequency", "density", "sentence"),
    [
        ((1.0, 3.0, 2.0), (1.0, 1.0, 1.0), "goes from 3 to 2 Hz; its frequencies must rise"),
        ((1.0, 2.0, 2.0), (1.0, 1.0, 1.0), "its frequencies must rise"),
        ((1.0, np.nan, 2.0), (1.0, 1.0, 1.0), "frequency.1 is nan; it must be a finite number"),
        ((0.0, 2.0), (1.0, 1.0), "frequency.0 is 0.0; it must be greater than 0"),
        ((1.0, np.inf), (1.0, 1.0), "frequency.1 is inf; it must be a finite number"),
        ((1.0, 2.0), (1.0, -1.0), "density.1 is -1.0; it must be greater than 0"),
        ((1.0, 2.0), (0.0, 1.0), "density.0 is 0.0; it must be greater than 0"),
        ((1.0, 2.0), (np.nan, 1.0), "density.0 is nan; it must be a finite number"),
        ((1.0, 2.0, 3.0), (1.0, 1.0), "has 3 frequencies and 2 densities"),
        ((1.0,), (1.0,), "at least 2 items"),
        ((), (), "at least 2 items"),
    ],
)
def test_a_table_that_is_none_is_refused(frequency, density, sentence):
    error = refused(TabulatedSpectrum, {"frequency": frequency, "density": density}, prefix="table")

    assert sentence in str(error)
    assert error.field.startswith("table.")


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"lowest_frequency": 0.0}, "lowest_frequency"),
        ({"lowest_frequency": -1.0}, "lowest_frequency"),
        ({"lowest_frequency": 50.0}, "highest_frequency"),
        ({"lowest_frequency": np.nan}, "lowest_frequency"),
        ({"highest_frequency": np.inf}, "highest_frequency"),
        ({"corner_frequency": 0.1}, "corner_frequency"),
        ({"corner_frequency": np.nan}, "corner_frequency"),
        ({"decibels_per_octave": -1.0}, "decibels_per_octave"),
        ({"decibels_per_octave": np.inf}, "decibels_per_octave"),
    ],
)
def test_a_band_a_corner_or_a_slope_that_is_not_allowed_is_refused(changes, field):
    error = refused(WhitePinkSpectrum, PINK | changes, prefix="excitation.spectrum")

    assert error.field == f"excitation.spectrum.{field}"


def test_an_excitation_has_a_level_and_a_spectrum_for_each_drive_of_a_rig():
    table = [[0.5, 1.0], [50.0, 4.0]]
    own = {"b": {"table": table}, "c": {"corner_frequency": 9.0, "decibels_per_octave": 3.0}}
    written = ExcitationSettings(**{**WRITTEN, "rms": {"c": 3.0, "a": 1.0, "b": 2.0}, "drive_spectra": own})

    found = written.resolved(["a", "b", "c"], seed=5)

    assert (found.levels, found.level_kind, found.seed, found.spectrum) == ((1.0, 2.0, 3.0), LevelKind.RMS, 5, None)
    a, b, c = found.spectra
    assert a == WhitePinkSpectrum(**PINK)
    assert b == TabulatedSpectrum(frequency=(0.5, 50.0), density=(1.0, 4.0))
    assert c == WhitePinkSpectrum(**{**PINK, "corner_frequency": 9.0, "decibels_per_octave": 3.0})


def test_one_level_and_one_spectrum_are_those_of_all_drives():
    found = ExcitationSettings(**{**WRITTEN, "rms": None, "peak": 0.5}).resolved(["a", "b"])

    assert (found.levels, found.level_kind, found.spectra) == ((0.5, 0.5), LevelKind.PEAK, (found.spectrum,) * 2)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"rms": {"a": 1.0}}, "excitation.rms has no value for b; it needs one for each of a, b."),
        (
            {"rms": {"a": 1.0, "b": 1.0, "x": 1.0}},
            "excitation.rms has unknown channel x; it needs one for each of a, b.",
        ),
        (
            {"drive_spectra": {"x": {"corner_frequency": 1.0}}},
            "excitation.drive_spectra has unknown channel x; the drives are a, b.",
        ),
    ],
)
def test_channels_that_a_rig_does_not_have_are_refused(changes, sentence):
    with pytest.raises(SettingsError) as caught:
        ExcitationSettings(**(WRITTEN | changes)).resolved(["a", "b"])

    assert str(caught.value) == sentence
