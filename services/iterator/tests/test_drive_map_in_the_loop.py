"""The loop with a drive map: a rig with an arc converges like its linear twin, whatever else a campaign uses."""

from dataclasses import replace

import numpy as np
import pytest

from duralab_drive_map import DriveMap, MapTerm, learn_drive_map
from duralab_settings import LimitPolicy, StopCriteria, UpdateKind
from duralab_spectra import rms
from iterator import (
    UPDATES,
    CampaignSettings,
    DriveLimitError,
    DriveLimits,
    DriveOverrunError,
    LimitQuantity,
    MapFromFirstPlayback,
    NextDrive,
    PlaybackBoundError,
    RecordedPlayback,
    UpdateSettings,
    apply_inverse,
    iterate,
    judge_response,
    predict,
    rig_model,
)
from iterator.model import DriveTerm

from .arc_rig import BAND, IDENTIFIED, KAPPA, LEVEL, NAMES, UNITS, drive, exact_model, play_arc
from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, play

H = impulse_responses()
IDENTITY = DriveMap(NAMES, UNITS, tuple(LEVEL), (), SAMPLE_RATE, IDENTIFIED[1])
# κ u_vertical² = s_lateral c (u_vertical / s_vertical)²
ARC = replace(IDENTITY, terms=(MapTerm(1, (0, 0), (KAPPA * LEVEL[0] ** 2 / LEVEL[1], 0.0, 0.0)),))
WANTED = drive(seed=5, seconds=25.0, level=LEVEL * (3.0, 0.5), highest=36.0)
TARGET = BAND.limit_target(play(H, WANTED))


def settings(
    *, kind=UpdateKind.SECANT, gain=0.8, iterations=4, responses=2, policy=LimitPolicy.PROJECT, levels=(), **update
):
    stop = update.pop("stop", StopCriteria(iterations=iterations))
    made = UpdateSettings(band=BAND, iteration_gain=np.full(responses, gain), kind=kind, **update)
    # With a map no rate limits are looked for, so the twin does not either.
    made = made.without_rate_limits
    return CampaignSettings(update=made, stop=stop, limit_policy=policy, largest_overrun=10.0, levels=levels)


def run(rig, given, *, model=None, target=TARGET, **options):
    return list(iterate(rig, target, model=model or exact_model(), settings=given, **options))


def linear(u):
    return play(H, u)


def as_twin(mapped, twin):
    """The rig with the arc and the map does what the linear one does: the same mapped drives, the same errors."""
    assert len(mapped) == len(twin)
    for one, other in zip(mapped, twin, strict=True):
        scale = np.abs(other.drive).max(axis=1, keepdims=True)
        np.testing.assert_allclose(ARC.to_mapped(one.drive) / scale, other.drive / scale, atol=2e-3)
        np.testing.assert_allclose(
            one.metrics.relative_rms_error, other.metrics.relative_rms_error, rtol=0.02, atol=1e-3
        )
    # Without the map it would be another drive.
    assert np.abs(mapped[-1].drive[1] - twin[-1].drive[1]).max() > 0.1 * np.abs(twin[-1].drive[1]).max()


@pytest.mark.parametrize("kind", list(UpdateKind))
@pytest.mark.parametrize("accept_segments", [False, True])
def test_every_update_converges_on_an_arc_as_on_the_linear_twin(kind, accept_segments):
    given = settings(kind=kind, accept_segments=accept_segments)
    mapped = run(play_arc, given, drive_map=ARC)
    as_twin(mapped, run(linear, given))
    assert mapped[-1].metrics.overall_relative_rms_error < 0.01
    assert run(play_arc, given)[0].metrics.overall_relative_rms_error > 1.5 * 0.2


@pytest.mark.parametrize("kind", list(UpdateKind))
@pytest.mark.parametrize("limits", [None, 0.9])
def test_without_a_map_and_with_the_identity_the_drives_are_the_same_bytes(kind, limits):
    given = settings(kind=kind, iterations=3, accept_segments=True, levels=(0.5, 1.0))
    limits = None if limits is None else limits_of(limits * np.abs(WANTED).max(axis=1))
    without, identity = (run(play_arc, given, limits=limits, drive_map=given_map) for given_map in (None, IDENTITY))
    for one, other in zip(without, identity, strict=True):
        assert one.drive.tobytes() == other.drive.tobytes()
        assert one.model.frf.tobytes() == other.model.frf.tobytes()


def test_a_learned_map_and_the_squares_of_the_secant_update_go_together():
    u = drive()
    learned = learn_drive_map(u, play_arc(u), model=exact_model(), names=NAMES, units=UNITS)
    for squares in (True, False):
        given = settings(gain=1.0, squares=squares)
        steps = run(play_arc, given, model=learned.model, drive_map=learned.drive_map)
        assert steps[0].metrics.overall_relative_rms_error < 0.02
        assert steps[-1].metrics.overall_relative_rms_error < 1e-3
        # What the map leaves is noise to the squares: the gate shuts them out.
        assert DriveTerm.SQUARE not in steps[-1].model.terms


def test_squares_of_mapped_drives_meet_what_the_map_leaves():
    """A map that knows a third of the arc."""
    (term,) = ARC.terms
    weak = replace(ARC, terms=(replace(term, coefficients=(term.coefficients[0] / 3.0, 0.0, 0.0)),))
    with_squares, without = (
        run(play_arc, settings(gain=1.0, squares=squares), drive_map=weak)[2].metrics.overall_relative_rms_error
        for squares in (True, False)
    )
    assert with_squares < 0.5 * without


def backward_for_once(rig):
    """Rig whose second answer has the wrong sign for 4 seconds."""
    answers = []

    def answer(u):
        y = rig(u)
        answers.append(None)
        if len(answers) == 2:
            y[:, 1600:2400] *= -1.0
        return y

    return answer


@pytest.mark.parametrize("kind", [UpdateKind.BASIC_TWR, UpdateKind.SECANT])
def test_segments_that_became_worse_go_back_to_the_mapped_drive_that_was_better(kind):
    given = settings(kind=kind, gain=0.6, accept_segments=True)
    mapped = run(backward_for_once(play_arc), given, drive_map=ARC)
    as_twin(mapped, run(backward_for_once(linear), given))
    not_back = run(backward_for_once(play_arc), settings(kind=kind, gain=0.6), drive_map=ARC)
    middle = slice(1800, 2200)
    assert np.all(rms((mapped[2].drive - not_back[2].drive)[:, middle]) > 0.2 * rms(mapped[2].drive[:, middle]))


@pytest.mark.parametrize("kind", list(UpdateKind))
def test_at_partial_levels_the_share_is_that_of_the_mapped_drive(kind):
    given = settings(kind=kind, levels=(0.3, 0.7, 1.0))
    mapped = run(play_arc, given, drive_map=ARC)
    as_twin(mapped, run(linear, given))
    first, last = mapped[0], mapped[-1]
    assert (first.level, last.level) == (0.3, 1.0)
    # The arc grows by the square: a share of the drive would not be the drive of a share.
    whole = ARC.to_drive(ARC.to_mapped(first.drive) / 0.3)
    assert np.abs(first.drive[1] - 0.3 * whole[1]).max() > 0.1 * np.abs(first.drive[1]).max()


def limits_of(peak, *, slew=(0.0, 0.0), **changes):
    peak = np.broadcast_to(np.asarray(peak, dtype=float), (2,))
    return replace(DriveLimits(NAMES, UNITS, -peak, peak, np.asarray(slew, dtype=float), SAMPLE_RATE), **changes)


def slow_bump():
    bump = np.zeros(4000)
    bump[1500:2500] = np.hanning(1000) ** 4
    return bump


def test_a_held_leader_costs_what_it_costs_the_linear_twin():
    """Limits of the vertical drive only: the twin's lateral one then does not depend on them."""
    limits = limits_of((0.6 * np.abs(WANTED[0]).max(), 1.0))
    played = []

    def rig(u):
        played.append(u)
        return play_arc(u)

    given = settings(kind=UpdateKind.BASIC_TWR)
    mapped = run(rig, given, limits=limits, drive_map=ARC)
    twin = run(linear, given, limits=limits)
    as_twin(mapped, twin)
    assert [passing.channel for passing in mapped[-1].projection.passings] == ["vertical"]
    found, expected = ([each.segment for each in steps[-1].unreachable] for steps in (mapped, twin))
    assert found == expected != []
    assert all(np.all(np.abs(u) <= limits.maximum[:, None]) for u in played)


@pytest.mark.parametrize("quantity", list(LimitQuantity))
def test_the_limits_of_a_follower_hold_for_what_is_played(quantity):
    def slew(u):
        return np.abs(np.diff(u, prepend=0.0)).max() * SAMPLE_RATE

    free = run(play_arc, settings(), drive_map=ARC)[-1].drive[1]
    if quantity is LimitQuantity.PEAK:
        limits = limits_of((1.0, 0.8 * np.abs(free).max()))
    else:
        limits = limits_of(1.0, slew=(0.0, 0.8 * slew(free)))
    steps = run(play_arc, settings(), limits=limits, drive_map=ARC)
    assert {(each.channel, each.quantity) for each in steps[-1].projection.passings} == {("lateral", quantity)}
    for step in steps:
        assert np.abs(step.drive[1]).max() <= limits.maximum[1]
        assert slew(step.drive[1]) <= (limits.slew_limit[1] or np.inf)
    assert steps[-1].metrics.overall_relative_rms_error < 0.1


def test_squares_are_left_out_while_a_drive_of_the_map_stands_at_its_limits():
    limits = limits_of((0.6 * np.abs(WANTED[0]).max(), 1.0))
    steps = run(play_arc, settings(accept_segments=True), limits=limits, drive_map=ARC)
    assert all(step.model.terms == () for step in steps[1:])


def test_a_first_drive_far_beyond_a_limit_is_refused_before_it_is_played():
    given = settings().model_copy(update={"largest_overrun": 1.2})
    fits = run(play_arc, settings(iterations=1), drive_map=ARC)[0].drive
    played = []
    with pytest.raises(DriveOverrunError, match="The target asks lateral for a peak of"):
        run(played.append, given, limits=limits_of((1.0, 0.5 * np.abs(fits[1]).max())), drive_map=ARC)
    assert played == []
    # The lateral drive of the linear twin alone would fit: what is too large is the arc that it follows.
    twin = ARC.to_mapped(fits)[1]
    assert np.abs(twin).max() < 1.2 * 0.5 * np.abs(fits[1]).max()


def test_the_first_drive_of_a_follower_is_that_after_the_limits_of_its_leader():
    """The vertical drive is held at half of its peak: a quarter of the arc remains for the lateral one to follow."""
    bump = slow_bump()
    mapped = np.vstack((0.04 * bump, 0.0 * bump))
    limits = limits_of((0.02, 1.5e-3))
    given = settings(iterations=1).model_copy(update={"largest_overrun": 2.1})
    options = {"target": TARGET[:, :4000], "limits": limits, "update": lambda _, model, __: NextDrive(mapped, model)}
    (step,) = run(play_arc, given, drive_map=ARC, **options)
    assert np.abs(ARC.to_drive(mapped)[1]).max() > 3.0 * limits.maximum[1]
    assert np.abs(step.drive[1]).max() < limits.maximum[1]


def test_a_refused_drive_names_a_share_of_the_gains_with_which_it_fits():
    given = settings(kind=UpdateKind.BASIC_TWR, gain=1.0, policy=LimitPolicy.REFUSE)
    first = run(play_arc, given, drive_map=ARC)[0].drive
    limits = limits_of((1.0, 0.8 * np.abs(first[1]).max()))
    with pytest.raises(DriveLimitError, match="The next drive of lateral would reach a peak of") as refused:
        run(play_arc, given, limits=limits, drive_map=ARC)
    share = refused.value.fitting_share
    assert 0.5 < share < 1.0
    smaller = settings(kind=UpdateKind.BASIC_TWR, gain=share, policy=LimitPolicy.REFUSE, iterations=1)
    run(play_arc, smaller, limits=limits, drive_map=ARC)
    as_twin(run(play_arc, given, limits=limits_of(1.0), drive_map=ARC), run(linear, given))


def test_a_share_that_fits_is_looked_for_where_the_drive_is_not_in_proportion_to_the_gains():
    """`s v - s² κ z²` is largest below full gain: a straight line from rest to the refused drive is below it."""
    bump = slow_bump()
    mapped = np.vstack((np.sqrt(3e-3 / KAPPA) * bump, 4e-3 * bump**2))

    def update(history, model, settings):
        return NextDrive(mapped, model, np.zeros_like(mapped))

    limits = limits_of((1.0, 0.9e-3))
    with pytest.raises(DriveLimitError) as refused:
        run(
            play_arc,
            settings(policy=LimitPolicy.REFUSE),
            target=TARGET[:, :4000],
            limits=limits,
            drive_map=ARC,
            update=update,
        )
    share = refused.value.fitting_share
    assert 0.1 < share < 0.5
    assert np.abs(ARC.to_drive(share * mapped)[1]).max() <= limits.maximum[1]
    with pytest.raises(DriveLimitError, match="no smaller iteration gain would fit") as none_fits:
        run(
            play_arc,
            settings(policy=LimitPolicy.REFUSE),
            target=TARGET[:, :4000],
            limits=limits_of((1.0, 1e-6)),
            drive_map=ARC,
            update=update,
        )
    assert none_fits.value.fitting_share == 0.0


def test_a_share_that_fits_counts_from_the_drive_of_the_mapped_drive_that_was_stepped_from():
    """Lateral mapped drives of 3.5 and 5.5 mm less an arc of 3 mm are drives of 0.5 and 2.5 mm; 1.5 mm are allowed."""
    bump = slow_bump()
    mapped = [np.vstack((np.sqrt(3e-3 / KAPPA) * bump, level * bump**2)) for level in (3.5e-3, 5.5e-3)]

    def update(history, model, settings):
        return NextDrive(mapped[1], model, mapped[0]) if history.playbacks else NextDrive(mapped[0], model)

    given, limits = settings(policy=LimitPolicy.REFUSE), limits_of((1.0, 1.5e-3))
    with pytest.raises(DriveLimitError, match=r"peak of 0\.0025 m, past the rig's limit of 0\.0015 m") as refused:
        run(play_arc, given, target=TARGET[:, :4000], limits=limits, drive_map=ARC, update=update)
    assert refused.value.fitting_share == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("kind", list(UpdateKind))
@pytest.mark.parametrize("held", [False, True])
def test_what_follows_recorded_playbacks_is_what_followed_them(kind, held):
    limits = limits_of((0.8 * np.abs(WANTED[0]).max(), 1.0)) if held else None
    given = settings(kind=kind, accept_segments=True, levels=(0.5, 1.0))
    options = {"limits": limits, "drive_map": ARC}
    whole = run(play_arc, given, **options)
    recorded = [RecordedPlayback(step.drive, step.response) for step in whole[:2]]
    played = []

    def rig(u):
        played.append(u)
        return play_arc(u)

    resumed = run(rig, given, recorded=recorded, **options)
    assert len(played) == 2
    for one, other in zip(whole, resumed, strict=True):
        assert one.drive.tobytes() == other.drive.tobytes()


def test_a_map_that_is_learned_from_the_first_playback_takes_up_that_playback():
    target = BAND.limit_target(play(H, drive(seed=5, seconds=60.0, level=LEVEL * (3.0, 0.5), highest=36.0)))
    given = settings(kind=UpdateKind.BASIC_TWR, gain=1.0, iterations=4)
    first = next(iterate(play_arc, target, model=exact_model(), settings=given))
    learned = learn_drive_map(
        first.drive, first.response, model=exact_model(), names=NAMES, units=UNITS, response_weight=1.0 / rms(target)
    )
    recorded = [RecordedPlayback(first.drive, first.response, with_drive_map=False)]
    steps = run(play_arc, given, target=target, recorded=recorded, drive_map=learned.drive_map)
    errors = [step.metrics.overall_relative_rms_error for step in steps]
    assert errors[0] > 0.1
    assert max(errors[1:]) < 0.01
    assert steps[0].drive.tobytes() == first.drive.tobytes()
    # The mapped drive has nothing below the band that was not in it before.
    mapped = learned.drive_map.to_mapped(steps[-1].drive)
    power = np.abs(np.fft.rfft(mapped[1])) ** 2
    frequency = np.fft.rfftfreq(mapped.shape[1], 1.0 / SAMPLE_RATE)
    assert power[frequency < 0.5].sum() < 1e-4 * power.sum()


def test_the_loop_learns_the_map_from_its_first_playback_where_the_identification_has_none():
    target = BAND.limit_target(play(H, drive(seed=5, seconds=60.0, level=LEVEL * (3.0, 0.5), highest=36.0)))
    given, to_learn = settings(gain=1.0, iterations=4), MapFromFirstPlayback(NAMES, UNITS)
    steps = run(play_arc, given, target=target, drive_map=to_learn)
    errors = [step.metrics.overall_relative_rms_error for step in steps]
    assert errors[0] > 0.1
    assert max(errors[1:]) < 0.01
    assert [step.with_drive_map for step in steps] == [False, True, True, True]
    assert steps[0].learned is not None
    assert steps[0].learned.drive_map.describe() == ("lateral follows −3 /m × vertical²",)
    assert [step.learned for step in steps[1:]] == [None] * 3
    # A campaign that goes on after two of them does what this one did.
    recorded = [RecordedPlayback(step.drive, step.response, step.with_drive_map) for step in steps[:2]]
    resumed = run(play_arc, given, target=target, drive_map=to_learn, recorded=recorded)
    assert [step.drive.tobytes() for step in resumed] == [step.drive.tobytes() for step in steps]


def test_a_map_that_knows_half_an_arc_is_learned_again_from_the_first_playback():
    target = BAND.limit_target(play(H, drive(seed=5, seconds=60.0, level=LEVEL * (3.0, 0.5), highest=36.0)))
    (term,) = ARC.terms
    # Learned from a record with 0.8 times the motion.
    weak = replace(term, coefficients=(0.5 * 0.8 * term.coefficients[0], 0.0, 0.0))
    start = replace(ARC, terms=(weak,), scale=tuple(0.8 * LEVEL))
    given = settings(kind=UpdateKind.BASIC_TWR, gain=0.6, iterations=4)
    to_learn = MapFromFirstPlayback(NAMES, UNITS, start=start)
    steps = run(play_arc, given, target=target, drive_map=to_learn)
    kept = run(play_arc, given, target=target, drive_map=start)
    errors, without = (np.array([step.metrics.relative_rms_error for step in each]) for each in (steps, kept))
    assert steps[0].drive.tobytes() == kept[0].drive.tobytes()
    assert steps[0].with_drive_map
    assert steps[0].learned is not None
    assert steps[0].learned.drive_map.describe() == ("lateral follows −3 /m × vertical²",)
    # From then on the rig is a linear one: a gain of 0.6 leaves 0.4 of the error of each response.
    np.testing.assert_allclose(errors[1:], 0.4 * errors[:-1], rtol=0.03)
    assert without[1, 1] > 1.1 * errors[1, 1]
    # A campaign that resumes after two playbacks does what this one did.
    recorded = [RecordedPlayback(step.drive, step.response, step.with_drive_map) for step in steps[:2]]
    resumed = run(play_arc, given, target=target, drive_map=to_learn, recorded=recorded)
    assert [step.drive.tobytes() for step in resumed] == [step.drive.tobytes() for step in steps]


def test_a_map_that_knows_the_arc_stays_and_changes_no_byte():
    target = BAND.limit_target(play(H, drive(seed=5, seconds=60.0, level=LEVEL * (3.0, 0.5), highest=36.0)))
    to_learn = MapFromFirstPlayback(NAMES, UNITS, start=ARC)
    steps, kept = (run(play_arc, settings(), target=target, drive_map=given) for given in (to_learn, ARC))
    assert [step.drive.tobytes() for step in steps] == [step.drive.tobytes() for step in kept]
    assert "explains the record as well" in steps[0].learned.remarks[0]


def test_a_first_playback_of_a_linear_rig_teaches_no_map_and_changes_no_byte():
    target = BAND.limit_target(play(H, drive(seed=5, seconds=60.0, level=LEVEL * (3.0, 0.5), highest=36.0)))
    model = rig_model(*frequency_response(1.1 * H), identified_band=IDENTIFIED)
    steps = run(linear, settings(), target=target, model=model, drive_map=MapFromFirstPlayback(NAMES, UNITS))
    without = run(linear, settings(), target=target, model=model)
    assert [step.drive.tobytes() for step in steps] == [step.drive.tobytes() for step in without]


def test_a_first_playback_teaches_no_map_that_rests_outside_the_limits():
    target = BAND.limit_target(play(H, drive(seed=5, seconds=60.0, level=LEVEL * (3.0, 0.5), highest=36.0)))
    off = DriveLimits(NAMES, UNITS, np.array([-1.0, 1e-9]), np.ones(2), np.zeros(2), SAMPLE_RATE)
    steps = run(
        play_arc, settings(iterations=2), target=target, drive_map=MapFromFirstPlayback(NAMES, UNITS), limits=off
    )
    assert [step.with_drive_map for step in steps] == [False, False]
    assert "lateral are 1e-09 to 1 m and the drive map rests at 0" in steps[0].learned.remarks[-1]


THREE = np.concatenate([H, 5e-4 * H[:1] + 0.3 * H[1:]])


def three_responses(u, *, kappa):
    return play(THREE, np.array([u[0], u[1] + kappa * u[0] ** 2]))


@pytest.mark.parametrize("kind", list(UpdateKind))
@pytest.mark.parametrize("watched", [False, True])
def test_more_responses_than_drives_and_watched_ones_converge_as_on_the_linear_twin(kind, watched):
    target = BAND.limit_target(play(THREE, WANTED))
    weight = 1.0 / rms(target)
    if watched:
        weight[2], target[2] = 0.0, 1e3 * target[0]
    model = rig_model(*frequency_response(THREE), identified_band=IDENTIFIED, response_weight=weight)
    given = settings(kind=kind, responses=3, accept_segments=True)
    mapped = run(lambda u: three_responses(u, kappa=KAPPA), given, model=model, target=target, drive_map=ARC)
    as_twin(mapped, run(lambda u: three_responses(u, kappa=0.0), given, model=model, target=target))
    assert mapped[-1].model.frf.shape == model.frf.shape
    assert np.all(mapped[-1].metrics.relative_rms_error[:2] < 0.01)


def test_an_own_update_works_on_mapped_drives():
    seen = []

    def update(history, model, settings):
        seen.append([playback.drive for playback in history.playbacks])
        last = history.playbacks[-1] if history.playbacks else None
        missing = history.target if last is None else history.target - last.response
        step = apply_inverse(model, settings.gains[:, None] * missing, band=settings.band)
        return NextDrive(step if last is None else last.drive + step, model)

    mapped = run(play_arc, settings(), drive_map=ARC, update=update)
    for step, known in zip(mapped, seen[-1], strict=False):
        np.testing.assert_array_equal(known, ARC.to_mapped(step.drive))
    as_twin(mapped, run(linear, settings(), update=update))


def test_the_response_that_bounds_are_checked_with_is_predicted_of_the_mapped_drive():
    bounded = settings(gain=1.0, stop=StopCriteria(iterations=3, peak_bound=1.1))
    mapped = run(play_arc, bounded, drive_map=ARC)
    assert [step.passed_bound for step in mapped] == [None] * 3
    # By the model, the drive itself would answer with the arc on top and be refused.
    of_drive = judge_response(TARGET, predict(exact_model(), mapped[0].drive, band=BAND))
    assert of_drive.peak_ratio[1] > 2.0
    played = []

    def doubling(history, model, settings):
        step = UPDATES[UpdateKind.BASIC_TWR](history, model, settings)
        return replace(step, drive=2.0 * step.drive)

    with pytest.raises(PlaybackBoundError):
        run(played.append, bounded, drive_map=ARC, update=doubling)
    assert played == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"names": ("a", "b")}, "for the drives a, b and the rig has vertical, lateral"),
        ({"units": ("mm", "m")}, "vertical in mm and the rig has it in m"),
        ({"sample_rate": 256.0}, "drives of 256 Hz and the model for those of 200 Hz"),
        ({"highest_frequency": 60.0}, "acts up to 60 Hz and the model is identified up to 41.7969 Hz"),
    ],
)
def test_a_map_that_does_not_fit_is_refused_before_the_rig_moves(change, said):
    played = []
    for map_ in (replace(ARC, **change), replace(IDENTITY, **change)):
        with pytest.raises(ValueError, match=said):
            run(played.append, settings(), limits=limits_of(1.0), drive_map=map_)
    assert played == []


def test_a_map_of_another_number_of_drives_is_refused_also_without_limits():
    one = replace(IDENTITY, names=NAMES[:1], units=UNITS[:1], scale=(1.0,))
    with pytest.raises(ValueError, match="The drive map has 1 drives and the model 2"):
        run(play_arc, settings(), drive_map=one)


@pytest.mark.parametrize("policy", list(LimitPolicy))
def test_limits_that_do_not_hold_the_rest_position_are_refused_before_the_rig_moves(policy):
    played = []
    limits = limits_of(1.0, minimum=np.array([-1.0, 0.1]))
    with pytest.raises(ValueError, match=r"lateral are 0\.1 to 1 m and the drive map rests at 0"):
        run(played.append, settings(policy=policy), limits=limits, drive_map=ARC)
    assert played == []
