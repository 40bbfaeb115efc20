import pytest
from short_experiments import RATE, WHITE, settings_of

from duralab_settings import ExcitationKind, SettingsError, WhitePinkSpectrum
from identifier.excitation import plan_experiment, white

RANDOM, BURST, SWEEP = ExcitationKind.PURE_RANDOM, ExcitationKind.BURST_RANDOM, ExcitationKind.SWEPT_SINE


STEEP = WhitePinkSpectrum(lowest_frequency=0.5, highest_frequency=50.0, corner_frequency=0.5, decibels_per_octave=1e5)
"""So steep that its density is 0 within its band, in floating point."""


@pytest.mark.parametrize(
    ("changes", "field", "message"),
    [
        (
            {"drive_spectra": (white(0.5, 500.0),) * 3},
            "excitation.spectrum.highest_frequency",
            "it must end below 500 Hz",
        ),
        ({"drive_spectra": (white(10.0, 10.1),) * 3}, "estimator.block_samples", "none to excite from 10 to 10.1 Hz"),
        (
            {"drive_spectra": (white(0.9, 1.0),) * 3, "odd_lines": True},
            "estimator.block_samples",
            "none to excite from 0.9 to 1 Hz",
        ),
        (
            {"drive_spectra": (white(0.5, 2.0),) * 3, "detection_share": 0.1},
            "excitation.detection_share",
            "leaves out none of 3 lines",
        ),
        ({"detection_share": 5e-324}, "excitation.detection_share", "of 4.94066e-324 leaves out none of"),
        ({"detection_share": 1e-20}, "excitation.detection_share", "of 1e-20 leaves out none of"),
        (
            {"drive_spectra": (WHITE, WHITE, STEEP)},
            "excitation.drive_spectra",
            r"The PSD of drive 2 is 0.0 at 0.9766 Hz",
        ),
        ({"fade": 2.1}, "excitation.fade", "the delay before each capture 2.048 s"),
        ({"fade": 0.6, "kind": BURST}, "excitation.fade", "each burst 1.024 s"),
        ({"duration": 18.0}, "excitation.duration", "last 18.682 s, fade included"),
        ({"realisations": 3}, "excitation.duration", "3 realisations of 9 blocks last 55.546 s"),
        (
            {"kind": ExcitationKind.PSEUDO_RANDOM, "realisations": 2},
            "excitation.realisations",
            "3 or more are needed for 3 drives",
        ),
        (
            {"kind": ExcitationKind.PSEUDO_RANDOM, "duration": 15.0},
            "excitation.duration",
            "of which the excitation's 15 s hold 2",
        ),
        ({"kind": RANDOM, "duration": 2.0}, "estimator.block_samples", "lasts only 1.5 s"),
        ({"kind": RANDOM, "duration": 6.0}, "excitation.duration", "6 are needed for 3 drives"),
        ({"kind": BURST, "duration": 12.0}, "excitation.duration", "holds 5 blocks.*take 13 s or more"),
        ({"kind": SWEEP, "duration": 8.0}, "excitation.duration", "holds 3 blocks.*4 are needed"),
    ],
)
def test_settings_that_do_not_fit_the_rig_or_would_not_identify_it_are_refused(changes, field, message):
    with pytest.raises(SettingsError, match=message) as refusal:
        plan_experiment(settings_of(**changes), drives=3, sample_rate=RATE)
    assert refusal.value.field == field


def test_as_many_levels_as_the_rig_has_drives_are_asked_for():
    with pytest.raises(SettingsError, match="3 values of rms were given; the rig has 6 drives"):
        plan_experiment(settings_of(3), drives=6, sample_rate=RATE)


def test_the_duration_that_a_refusal_of_pure_random_names_is_enough():
    asked = {"kind": RANDOM, "duration": 6.0}
    with pytest.raises(SettingsError) as refusal:
        plan_experiment(settings_of(**asked), drives=3, sample_rate=RATE)
    seconds = float(str(refusal.value).split("so take ")[1].split(" s ")[0])
    told = plan_experiment(settings_of(**(asked | {"duration": seconds})), drives=3, sample_rate=RATE)
    assert 6.0 <= told.independent_averages < 7.0
