import numpy as np
import pytest

from duralab_settings import StopCriteria, UpdateKind
from iterator import (
    UPDATES,
    AcceptanceSettings,
    CampaignSettings,
    DriveLimitError,
    DriveLimits,
    NextDrive,
    Outcome,
    UpdateSettings,
    apply_inverse,
    control_band,
    iterate,
    rig_model,
    run_campaign,
    step_start,
)

from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

BAND = control_band(2.0, 60.0, sample_rate=SAMPLE_RATE)
H = impulse_responses()
MODEL = rig_model(*frequency_response(H), identified_band=(1.0, 70.0))


def settings(*, kind=UpdateKind.BASIC_TWR, gain=0.5, accept_segments=False, acceptance=None, levels=(), **stop):
    return CampaignSettings(
        update=UpdateSettings(
            band=BAND,
            iteration_gain=np.full(2, gain),
            kind=kind,
            accept_segments=accept_segments,
            acceptance=acceptance or AcceptanceSettings(),
        ),
        stop=StopCriteria(**{"iterations": 5, **stop}),
        levels=levels,
    )


def plain(history, model, settings):
    """Basic TWR, written without its code."""
    last = history.playbacks[-1] if history.playbacks else None
    missing = history.target if last is None else history.target - last.response
    step = apply_inverse(model, settings.gains[:, None] * missing, band=settings.band)
    return NextDrive(drive=step if last is None else last.drive + step, model=model)


def run(update, settings, *, rig=lambda drive: play(H, drive), target=None, limits=None):
    target = noise_target(3001) if target is None else target
    return run_campaign(rig, target, model=MODEL, settings=settings, limits=limits, update=update)


def limits_of(peak):
    return DriveLimits(("left", "right"), ("m", "m"), np.full(2, -peak), np.full(2, peak), np.zeros(2), SAMPLE_RATE)


@pytest.mark.parametrize("levels", [(), (0.5, 1.0)])
def test_an_own_update_converges_as_its_equation_says_and_ends_by_the_stop_criteria(levels):
    used = run(plain, settings(levels=levels))
    assert used.outcome is Outcome.ITERATIONS_USED
    for iteration in used.iterations:
        np.testing.assert_allclose(iteration.metrics.relative_rms_error, 0.5**iteration.number, rtol=0.01)
    assert [iteration.level for iteration in used.iterations[:2]] == [*levels, 1.0, 1.0][:2]
    reached = run(plain, settings(levels=levels, relative_rms_error=0.2))
    assert reached.outcome is Outcome.REACHED
    assert len(reached.iterations) == 3


@pytest.mark.parametrize("kind", list(UpdateKind))
def test_a_shipped_update_given_as_an_own_one_makes_the_same_drives_also_where_acceptance_rolls_back(kind):
    target = noise_target(3001)

    def hardening(drive):
        linear = play(H, drive)
        return linear * (1.0 + 1.8 * np.tanh(np.abs(linear) / 500.0))

    wanted = settings(
        kind=kind, gain=0.9, accept_segments=True, acceptance=AcceptanceSettings(judged_seconds=0.5), levels=(0.5, 1.0)
    )
    other_kind = next(other for other in UpdateKind if other is not kind)
    shipped, own = (
        run(update, given, rig=hardening, target=target)
        for update, given in (
            (None, wanted),
            (
                UPDATES[kind],
                wanted.model_copy(update={"update": wanted.update.model_copy(update={"kind": other_kind})}),
            ),
        )
    )
    for one, other in zip(shipped.iterations, own.iterations, strict=True):
        np.testing.assert_array_equal(one.drive, other.drive)


def test_an_own_update_that_steps_from_the_accepted_start_goes_back_where_the_last_playback_was_worse():
    """The second playback answers with the wrong sign: the step after it starts from the first drive, at half size."""
    target = BAND.limit_target(noise_target(3001))
    answers = iter((0.5 * target, -target, target))

    def update(history, model, settings):
        if not history.playbacks:
            return plain(history, model, settings)
        start = step_start(history, model, settings)
        drive = start.drive_toward(history.target, band=settings.band)
        return NextDrive(drive=drive, model=model, stepped_from=start.drive)

    wanted = settings(iterations=3, accept_segments=True)
    first, _, third = run(update, wanted, rig=lambda _: next(answers), target=target).iterations
    missing = BAND.limit_target(target) - BAND.limit_response(0.5 * target)
    step = apply_inverse(MODEL, 0.5 * missing, band=BAND)
    moving = slice(800, 2200)
    np.testing.assert_allclose(
        (third.drive - first.drive)[:, moving], 0.5 * step[:, moving], atol=1e-3 * np.abs(step).max()
    )


def test_the_drive_of_an_own_update_is_held_to_the_limits_of_the_rig():
    largest = max(float(np.abs(iteration.drive).max()) for iteration in run(plain, settings()).iterations)
    run(plain, settings(), limits=limits_of(1.01 * largest))
    with pytest.raises(DriveLimitError, match="past the rig's limit"):
        run(plain, settings(), limits=limits_of(0.8 * largest))


def test_an_own_update_sees_the_controlled_responses_only():
    seen = []

    def update(history, model, settings):
        seen.append((history.target.shape[0], model.frf.shape[1], settings.gains.size))
        return plain(history, model, settings)

    h = np.concatenate([H, H[:1]])
    model = rig_model(
        *frequency_response(h), identified_band=(1.0, 70.0), response_weight=np.array([1e-3, 2.5e-2, 0.0])
    )
    wanted = settings(iterations=2)
    wanted = wanted.model_copy(update={"update": wanted.update.model_copy(update={"iteration_gain": (0.5,) * 3})})
    run_campaign(
        lambda drive: play(h, drive),
        noise_target(3001, level=(900.0, 40.0, 1.0)),
        model=model,
        settings=wanted,
        update=update,
    )
    assert seen == [(2, 2, 2)] * 2


def spoil_the_history(history, model, settings):
    history.target[...] = 0.0
    return plain(history, model, settings)


@pytest.mark.parametrize(
    ("update", "error", "message"),
    [
        ("momentum", TypeError, "`update` is 'momentum'; it must be a function"),
        (lambda history, *_: history.target, TypeError, "returned ndarray; it must return a NextDrive"),
        (
            lambda h, model, _: NextDrive(h.target[:, :-1], model),
            ValueError,
            r"shape \(2, 3000\); it must be \(2, 3001\)",
        ),
        (lambda h, model, _: NextDrive(h.target * np.nan, model), ValueError, "drive of the NextDrive .* holds nan"),
        (lambda h, model, _: NextDrive(h.target, model, h.target[:1]), ValueError, "stepped_from of the NextDrive"),
        (lambda h, *_: NextDrive(h.target, None), ValueError, "is NoneType; it must be a RigModel"),
        (spoil_the_history, ValueError, "read-only"),
    ],
)
def test_an_own_update_that_returns_what_cannot_be_played_is_refused_before_the_rig_moves(update, error, message):
    played = []
    steps = iterate(played.append, noise_target(3001), model=MODEL, settings=settings(), update=update)
    with pytest.raises(error, match=message):
        next(steps)
    assert played == []


@pytest.mark.parametrize("kind", [plain, "BASIC_TWR", 1, None])
def test_a_kind_of_update_that_is_none_of_the_enumeration_is_refused_and_the_way_named(kind):
    with pytest.raises(TypeError, match=r"it must be an UpdateKind: .*`run_campaign\(\.\.\., update=function\)`"):
        UpdateSettings(band=BAND, iteration_gain=np.ones(2), kind=kind)
