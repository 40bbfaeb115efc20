import numpy as np
import pytest

from duralab_drive_map import learn_drive_map
from duralab_settings import UpdateKind
from duralab_spectra import overall_relative_rms_error, rms
from iterator import UPDATES, IterationHistory, Playback, UpdateSettings

from .arc_rig import (
    BAND,
    KAPPA,
    LEVEL,
    NAMES,
    UNITS,
    drive,
    exact_model,
    play_arc,
)
from .linear_plants import impulse_responses, play


def learn(u, y, model=None, **options):
    return learn_drive_map(u, y, model=model or exact_model(), names=NAMES, units=UNITS, **options)


def reached(u):
    """Target that the rig can reach: its response to a drive."""
    return BAND.limit_target(play_arc(u))


def errors(target, model, rig, *, drive_map=None, kind=UpdateKind.BASIC_TWR, gain=0.8, playbacks=5):
    settings = UpdateSettings(band=BAND, iteration_gain=np.full(2, gain), kind=kind)
    history, found = IterationHistory(target=target), []
    for _ in range(playbacks):
        step = UPDATES[kind](history, model, settings)
        model = step.model
        u = step.drive if drive_map is None else drive_map.to_drive(step.drive)
        mapped = u if drive_map is None else drive_map.to_mapped(u)
        playback = Playback(drive=mapped, response=BAND.limit_response(rig(u)))
        history = history.after(playback)
        found.append(overall_relative_rms_error(target, playback.response))
    return np.array(found)


def test_with_the_map_the_rig_converges_like_its_linear_twin_and_without_it_does_not():
    u = drive()
    learned = learn(u, play_arc(u))
    louder = drive(seed=5, seconds=40.0, level=LEVEL * (3.0, 0.5))
    target = BAND.limit_target(play(impulse_responses(), louder))
    twin = errors(target, exact_model(), lambda played: play(impulse_responses(), played))
    mapped = errors(target, learned.model, play_arc, drive_map=learned.drive_map)
    np.testing.assert_allclose(mapped, twin, rtol=0.01, atol=1e-4)
    assert errors(target, exact_model(), play_arc)[0] > 1.5 * mapped[0]
    secant = errors(target, learned.model, play_arc, drive_map=learned.drive_map, kind=UpdateKind.SECANT, gain=1.0)
    assert secant[-1] < 1e-3


def test_a_map_is_learned_from_the_first_playback():
    """Without a record of the identification: the first playback of the model's drive has all of the arc in it."""
    target = reached(drive(seed=5, seconds=60.0, level=LEVEL * (2.0, 1.0)))
    model, settings = exact_model(), UpdateSettings(band=BAND, iteration_gain=np.ones(2), kind=UpdateKind.BASIC_TWR)
    u = UPDATES[settings.kind](IterationHistory(target=target), model, settings).drive
    y = play_arc(u)
    learned = learn(u, y, model, response_weight=1.0 / rms(target))
    (term,) = learned.drive_map.terms
    assert learned.drive_map.static_coefficient(term) == pytest.approx(-KAPPA, rel=0.01)
    mapped = BAND.limit_drive(learned.drive_map.to_mapped(u))
    first = Playback(drive=mapped, response=BAND.limit_response(y))
    history = IterationHistory(target=target).after(first)
    step = UPDATES[settings.kind](history, model, settings)
    response = BAND.limit_response(play_arc(learned.drive_map.to_drive(step.drive)))
    assert overall_relative_rms_error(target, first.response) > 0.1
    assert overall_relative_rms_error(target, response) < 0.01
