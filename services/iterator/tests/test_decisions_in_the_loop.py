"""Decisions in the loop itself: what a change, a way back and nothing at all make of the drives that follow."""

import numpy as np
import pytest

from duralab_settings import HoldPoint, HoldSettings, StopCriteria, UpdateKind
from duralab_spectra import rms
from iterator import CampaignSettings, MapFromFirstPlayback, RecordedPlayback, UpdateSettings, control_band, iterate
from iterator.holds import Basis, Revision, drive_use, hold_reason
from iterator.limits import DriveLimits

from .arc_rig import BAND, IDENTIFIED, LEVEL, NAMES, UNITS, drive, exact_model, play_arc
from .linear_plants import SAMPLE_RATE, impulse_responses, play

H = impulse_responses()
WANTED = drive(seed=5, seconds=25.0, level=LEVEL * (3.0, 0.5), highest=36.0)
TARGET = BAND.limit_target(play(H, WANTED))
MODEL = exact_model()


def settings(*, gain=0.5, kind=UpdateKind.BASIC_TWR, band=BAND, iterations=5, levels=()):
    update = UpdateSettings(band=band, iteration_gain=np.full(2, gain), kind=kind)
    return CampaignSettings(update=update, stop=StopCriteria(iterations=iterations), levels=levels)


def basis(*, target=TARGET, **given):
    return Basis(target, MODEL, settings(**given))


def run(given, *, rig=lambda u: play(H, u), decide=None, **options):
    return list(iterate(rig, TARGET, model=MODEL, settings=given, decide=decide, **options))


def scripted(script, seen=None):
    """Decide by a script: the revisions before each playback, in order."""
    left = {number: list(revisions) for number, revisions in script.items()}

    def decide(number, proposed):
        if seen is not None and proposed is not None:
            seen.append(proposed)
        return left[number].pop(0) if left.get(number) else None

    return decide


def same(ones, others):
    assert len(ones) == len(others)
    for one, other in zip(ones, others, strict=True):
        np.testing.assert_array_equal(one.drive, other.drive)
        np.testing.assert_array_equal(one.metrics.relative_rms_error, other.metrics.relative_rms_error)


@pytest.mark.parametrize("kind", list(UpdateKind))
def test_who_only_says_play_changes_no_bit(kind):
    given = settings(kind=kind, levels=(0.5, 1.0))
    same(run(given, decide=scripted({})), run(given))


@pytest.mark.parametrize("kind", list(UpdateKind))
def test_a_way_back_makes_the_drive_that_followed_then(kind):
    seen = []
    made = run(settings(kind=kind), decide=scripted({5: [Revision(from_iteration=2)]}, seen))
    np.testing.assert_array_equal(made[4].drive, made[2].drive)
    assert [proposed.follows for proposed in seen] == [0, 1, 2, 3, 4, 2]
    np.testing.assert_array_equal(seen[5].last_drive, made[1].drive)
    # What it is predicted to give, and how surely, is what was predicted then.
    np.testing.assert_array_equal(seen[5].forecast.response, seen[2].forecast.response)
    np.testing.assert_array_equal(seen[5].forecast.uncertainty, seen[2].forecast.uncertainty)


def test_a_way_back_and_forth_again_changes_no_bit():
    given = settings(kind=UpdateKind.ADAPTIVE_MODELLING)
    back_and_forth = [Revision(from_iteration=1), Revision(from_iteration=3)]
    same(run(given, decide=scripted({4: back_and_forth})), run(given))


def test_the_playback_after_a_way_back_is_made_from_what_it_led_to():
    seen = []
    made = run(settings(iterations=5), decide=scripted({4: [Revision(from_iteration=1)]}, seen))
    assert seen[-1].follows == 4
    errors = [float(iteration.metrics.overall_relative_rms_error) for iteration in made]
    assert errors == pytest.approx([0.5, 0.25, 0.125, 0.25, 0.125], rel=0.02)


def test_a_changed_gain_counts_from_that_playback_on():
    bold = Revision(basis(gain=0.9, iterations=4))
    made = run(settings(iterations=4), decide=scripted({3: [bold]}))
    errors = [float(iteration.metrics.overall_relative_rms_error) for iteration in made]
    assert errors == pytest.approx([0.5, 0.25, 0.025, 0.0025], rel=0.05)
    assert [iteration.comparable_from for iteration in made] == [1, 1, 1, 1]


def test_what_adaptive_modelling_learned_is_kept_with_the_gain_and_learned_anew_with_the_kind():
    rig = lambda u: 1.3 * play(H, u)  # noqa: E731 - the model is 30 % short of it
    kind = UpdateKind.ADAPTIVE_MODELLING
    kept = run(settings(kind=kind), rig=rig, decide=scripted({4: [Revision(basis(kind=kind, gain=0.9))]}))
    assert not np.array_equal(kept[3].model.inverse_frf, MODEL.inverse_frf)
    other = run(settings(kind=kind), rig=rig, decide=scripted({4: [Revision(basis(gain=0.9))]}))
    np.testing.assert_array_equal(other[3].model.inverse_frf, MODEL.inverse_frf)


@pytest.mark.parametrize("kind", list(UpdateKind))
def test_a_changed_band_is_driven_and_judged_in_itself_alone(kind):
    narrow = control_band(4.0, 15.0, sample_rate=SAMPLE_RATE, excited=IDENTIFIED)
    target = narrow.limit_target(play(H, WANTED))
    change = Revision(Basis(target, MODEL, settings(kind=kind, gain=1.0, band=narrow, iterations=4)))
    seen = []
    made = run(settings(kind=kind, iterations=4), decide=scripted({3: [change]}, seen))
    assert [iteration.comparable_from for iteration in made] == [1, 1, 3, 3]
    frequency = np.fft.rfftfreq(TARGET.shape[1], 1.0 / SAMPLE_RATE)
    density = np.abs(np.fft.rfft(made[3].drive)) ** 2
    assert density[:, frequency > narrow.highest_driven + 1.0].sum() < 1e-6 * density.sum()
    assert made[2].metrics.overall_relative_rms_error < 0.03
    # A miss in another band says nothing of this one.
    assert np.isnan(seen[3].forecast.uncertainty).all()
    np.testing.assert_allclose(rms(target - made[2].response_in_band) / rms(target), made[2].metrics.relative_rms_error)


def test_recorded_playbacks_and_their_revisions_are_gone_through_to_the_same_bytes():
    script = {2: [Revision(basis(gain=0.8))], 4: [Revision(from_iteration=2), Revision(basis(gain=0.3))]}
    given = settings(kind=UpdateKind.SECANT)
    whole = run(given, decide=scripted(script))
    for played in range(1, 5):
        recorded = [RecordedPlayback(each.drive, each.response) for each in whole[:played]]
        same(run(given, decide=scripted(script), recorded=recorded), whole)


def test_a_way_back_before_the_drive_map_was_learned_maps_the_drive():
    to_learn = MapFromFirstPlayback(NAMES, UNITS)
    given = settings(kind=UpdateKind.SECANT, gain=0.8)
    script = {3: [Revision(from_iteration=1)]}
    plain = run(given, rig=play_arc, drive_map=to_learn)
    back = run(given, rig=play_arc, drive_map=to_learn, decide=scripted(script))
    np.testing.assert_array_equal(back[2].drive, plain[1].drive)
    assert plain[0].learned is not None


def test_a_drive_that_cannot_be_made_is_proposed_as_refused_and_raised_where_nothing_changes():
    limits = DriveLimits(NAMES, UNITS, np.full(2, -1e-6), np.full(2, 1e-6), np.zeros(2), SAMPLE_RATE)
    seen = []
    with pytest.raises(ValueError, match="past the rig's limit"):
        run(settings(), limits=limits, decide=scripted({}, seen))
    assert seen[0].drive is seen[0].forecast is None
    assert "past the rig's limit" in str(seen[0].refusal)


@pytest.mark.parametrize(
    ("hold", "is_first", "said"),
    [
        (HoldSettings(when=HoldPoint.NEVER), True, ""),
        (HoldSettings(when=HoldPoint.FIRST), True, "before its first playback"),
        (HoldSettings(when=HoldPoint.FIRST), False, ""),
        (HoldSettings(when=HoldPoint.EACH), False, "before each playback"),
        (HoldSettings(when=HoldPoint.PREDICTED, predicted_peak=0.45), False, "predicted peak of"),
        (HoldSettings(when=HoldPoint.PREDICTED, predicted_peak=0.55), False, ""),
        (HoldSettings(when=HoldPoint.PREDICTED, predicted_damage=0.028), False, "predicted damage of"),
        (HoldSettings(when=HoldPoint.PREDICTED, predicted_damage=0.034), False, ""),
    ],
)
def test_when_a_campaign_waits(hold, is_first, said):
    """With an exact model a drive at half the gain gives half the peak, and 0.5⁵ = 0.031 of the damage."""
    seen = []
    run(settings(iterations=1), decide=scripted({}, seen))
    options = {"forecast": seen[0].forecast, "stop": StopCriteria(iterations=1), "names": NAMES}
    reason = hold_reason(hold, is_first=is_first, level=1.0, **options)
    assert said in reason
    assert bool(reason) == bool(said)
    if hold.when is HoldPoint.PREDICTED:
        # Bounds are relative to the whole target: at half the level it is far from them.
        assert hold_reason(hold, is_first=is_first, level=0.5, **options) == ""


def test_shares_of_limits_and_the_change_are_those_of_a_known_drive():
    time = np.arange(2000) / SAMPLE_RATE
    sine = np.sin(2.0 * np.pi * 2.0 * time)
    limits = DriveLimits(NAMES, UNITS, np.array([-0.5, -0.2]), np.array([1.0, 0.2]), np.array([10.0, 0.0]), SAMPLE_RATE)
    one, other = drive_use(np.array([0.1 * sine, 0.1 * sine]), np.array([0.08 * sine, 0.0 * sine]), limits=limits)
    assert (one.peak, other.peak) == pytest.approx((0.1, 0.1), rel=1e-3)
    # The nearer limit counts.
    assert (one.range_share, other.range_share) == pytest.approx((0.2, 0.5), rel=1e-3)
    assert one.slew == pytest.approx(0.1 * 2.0 * np.pi * 2.0, rel=1e-2)
    assert (one.slew_share, other.slew_share) == pytest.approx((one.slew / 10.0, 0.0))
    assert (one.change, other.change) == pytest.approx((0.25, 1.0))
