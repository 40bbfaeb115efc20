import numpy as np
import pytest
from short_experiments import RATE, WHITE, settings_of

from identifier.excitation import ExcitationKind, LevelKind, White, plan_experiment
from identifier.setting_error import SettingError

RANDOM, BURST, SWEEP = ExcitationKind.PURE_RANDOM, ExcitationKind.BURST_RANDOM, ExcitationKind.SWEPT_SINE


@pytest.mark.parametrize(
    ("changes", "field", "message"),
    [
        ({"levels": (1.0, 0.0, 1.0)}, "excitation.rms", "The RMS of drive 1 is 0.0"),
        ({"levels": (1.0, 1e308, 1.0)}, "excitation.rms", "at most 1e\\+12"),
        ({"levels": (1.0, np.nan, 1.0)}, "excitation.rms", "The RMS of drive 1 is nan"),
        ({"levels": (1.0, 1.0, -1.0), "level_kind": LevelKind.PEAK}, "excitation.peak", "The peak of drive 2 is -1.0"),
        ({"levels": (1.0, 1.0)}, "excitation.rms", "2 levels and 3 spectra"),
        ({"levels": (), "spectra": ()}, "excitation.rms", "0 levels and 0 spectra"),
        ({"spectra": (WHITE, WHITE, White(1.0, 50.0))}, "excitation.drive_spectra", "drive 2 spans 1 to 50 Hz"),
        ({"duration_seconds": np.nan}, "excitation.duration_seconds", "lasts nan s"),
        ({"duration_seconds": 0.0}, "excitation.duration_seconds", "lasts 0.0 s"),
        ({"fade_seconds": -0.1}, "excitation.fade_seconds", "lasts -0.1 s"),
        ({"fade_seconds": 20.0}, "excitation.fade_seconds", "less than half the excitation"),
        ({"seed": -1}, "excitation.seed", "The seed is -1"),
        ({"seed": 1.5}, "excitation.seed", "The seed is 1.5; it must be a whole number"),
        ({"block_samples": 2047}, "estimator.block_samples", "2047 samples; it must be a whole, even number"),
        ({"block_samples": 2048.5}, "estimator.block_samples", "2048.5 samples"),
        ({"block_samples": 128}, "estimator.block_samples", "256 or more"),
        ({"overlap": 1.0}, "estimator.overlap", "less than 1"),
        ({"delay_blocks": 0}, "excitation.delay_blocks", "without a delay the transient stays"),
        ({"delay_blocks": 1.5}, "excitation.delay_blocks", "delay_blocks is 1.5; it must be a whole number"),
        ({"capture_blocks": 0}, "excitation.capture_blocks", "capture_blocks is 0"),
        ({"repeats": -1}, "excitation.repeats", "repeats is -1"),
        ({"repeats": -1, "kind": RANDOM}, "excitation.repeats", "repeats is -1"),
        ({"realisations": 0}, "excitation.realisations", "realisations is 0"),
        ({"realisations": True}, "excitation.realisations", "realisations is True"),
        ({"burst_share": 0.0}, "excitation.burst_share", "A burst fills 0.0 of its block"),
        ({"detection_share": 0.6}, "excitation.detection_share", "it must be from 0 to 0.5"),
        ({"detection_share": np.nan}, "excitation.detection_share", "share of nan"),
        ({"odd_lines": True, "kind": RANDOM}, "excitation.odd_lines", "odd_lines is set for pure_random"),
        ({"minimise_crest_factor": True, "kind": SWEEP}, "excitation.minimise_crest_factor", "set for swept_sine"),
    ],
)
def test_settings_that_are_wrong_on_any_rig_are_refused(changes, field, message):
    with pytest.raises(SettingError, match=message) as refusal:
        settings_of(**changes)
    assert refusal.value.field == field


class Notched(White):
    """Zero at one line inside its band."""

    def density(self, frequency):
        return np.where(np.abs(frequency - 20.0) < 0.3, 0.0, super().density(frequency))


@pytest.mark.parametrize(
    ("changes", "field", "message"),
    [
        ({"spectra": (White(0.5, 500.0),) * 3}, "excitation.spectrum.highest_frequency", "it must end below 500 Hz"),
        ({"spectra": (White(10.0, 10.1),) * 3}, "estimator.block_samples", "none to excite from 10 to 10.1 Hz"),
        (
            {"spectra": (White(0.9, 1.0),) * 3, "odd_lines": True},
            "estimator.block_samples",
            "none to excite from 0.9 to 1 Hz",
        ),
        (
            {"spectra": (White(0.5, 2.0),) * 3, "detection_share": 0.1},
            "excitation.detection_share",
            "leaves out none of 3 lines",
        ),
        ({"detection_share": 5e-324}, "excitation.detection_share", "of 4.94066e-324 leaves out none of"),
        ({"detection_share": 1e-20}, "excitation.detection_share", "of 1e-20 leaves out none of"),
        (
            {"spectra": (WHITE, WHITE, Notched(0.5, 50.0))},
            "excitation.drive_spectra",
            r"The PSD of drive 2 is 0.0 at 20.02 Hz",
        ),
        ({"fade_seconds": 2.1}, "excitation.fade_seconds", "the delay before each capture 2.048 s"),
        ({"fade_seconds": 0.6, "kind": BURST}, "excitation.fade_seconds", "each burst 1.024 s"),
        ({"duration_seconds": 18.0}, "excitation.duration_seconds", "last 18.682 s, fade included"),
        ({"realisations": 3}, "excitation.duration_seconds", "3 realisations of 9 blocks last 55.546 s"),
        (
            {"kind": ExcitationKind.PSEUDO_RANDOM, "realisations": 2},
            "excitation.realisations",
            "3 or more are needed for 3 drives",
        ),
        (
            {"kind": ExcitationKind.PSEUDO_RANDOM, "duration_seconds": 15.0},
            "excitation.duration_seconds",
            "of which the excitation's 15 s hold 2",
        ),
        ({"kind": RANDOM, "duration_seconds": 2.0}, "estimator.block_samples", "lasts only 1.5 s"),
        ({"kind": RANDOM, "duration_seconds": 6.0}, "excitation.duration_seconds", "6 are needed for 3 drives"),
        ({"kind": BURST, "duration_seconds": 12.0}, "excitation.duration_seconds", "holds 5 blocks.*take 13 s or more"),
        ({"kind": SWEEP, "duration_seconds": 8.0}, "excitation.duration_seconds", "holds 3 blocks.*4 are needed"),
    ],
)
def test_settings_that_do_not_fit_the_rig_or_would_not_identify_it_are_refused(changes, field, message):
    with pytest.raises(SettingError, match=message) as refusal:
        plan_experiment(settings_of(**changes), drives=3, sample_rate=RATE)
    assert refusal.value.field == field


def test_as_many_levels_as_the_rig_has_drives_are_asked_for():
    with pytest.raises(SettingError, match="3 values of rms were given; the rig has 6 drives"):
        plan_experiment(settings_of(3), drives=6, sample_rate=RATE)


def test_the_duration_that_a_refusal_of_pure_random_names_is_enough():
    asked = {"kind": RANDOM, "duration_seconds": 6.0}
    with pytest.raises(SettingError) as refusal:
        plan_experiment(settings_of(**asked), drives=3, sample_rate=RATE)
    seconds = float(str(refusal.value).split("so take ")[1].split(" s ")[0])
    told = plan_experiment(settings_of(**(asked | {"duration_seconds": seconds})), drives=3, sample_rate=RATE)
    assert 6.0 <= told.independent_averages < 7.0
