"""Settings and result of a campaign that corrects the drive of a worn specimen."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.arrays import to_array, to_record
from duralab_proto.keys import Keys
from duralab_proto.v1 import array_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from duralab_settings import ResolvedUpdate, SecantSettings, UpdateKind
from duralab_settings.messages import fill_message, from_message
from sequencer.endurance import iterate_again
from sequencer.endurance.iterate_again import update_of_worn


def test_the_new_steps_count_more_than_the_old_model_and_everything_else_stays():
    before = ResolvedUpdate(
        kind=UpdateKind.SECANT, iteration_gain=(1.0, 0.5), gain_schedule=(0.8, 1.0), accept_segments=True
    )
    after = update_of_worn(before)
    assert after.iteration_gain == pytest.approx((0.9, 0.45))
    assert after.secant == SecantSettings(forgetting=0.5, prior_strength=0.1, speed_terms=True, whole_record=True)
    unchanged = {"secant": before.secant, "iteration_gain": before.iteration_gain}
    assert after.model_copy(update=unchanged) == before


def test_what_a_person_made_to_follow_faster_stays_so():
    secant = SecantSettings(forgetting=0.1, prior_strength=0.01, caution=0.2)
    after = update_of_worn(ResolvedUpdate(kind=UpdateKind.SECANT, iteration_gain=(1.0,), secant=secant))
    assert after.secant == secant.model_copy(update={"speed_terms": True, "whole_record": True})


def test_a_message_holds_the_settings_also_where_it_had_none_of_the_secant_update():
    message = iterator_pb2.UpdateSettings(kind=iterator_pb2.UPDATE_KIND_SECANT)
    fill_message(message, ResolvedUpdate(kind=UpdateKind.SECANT, iteration_gain=(1.0,)))
    message.ClearField("secant")
    wanted = update_of_worn(from_message(message, ResolvedUpdate))
    fill_message(message, wanted)
    assert from_message(message, ResolvedUpdate) == wanted


def put_error(metrics, error):
    """Set the overall error, or that of each channel and their root mean square."""
    channels = np.atleast_1d(error)
    metrics.overall_relative_rms_error = np.sqrt(np.mean(np.square(channels)))
    for name, each in zip("ab", channels, strict=False):
        metrics.channels.add(channel=name, relative_rms_error=each)


def finished(*errors, best, first=None):
    phase = iterator_pb2.CAMPAIGN_PHASE_FINISHED
    status = iterator_pb2.CampaignStatus(id="again", phase=phase, best_iteration=best)
    for number, error in enumerate(errors, start=1):
        put_error(status.iterations.add(iteration=number), error)
    if first is not None:
        put_error(status.first_drive, first)
    return status


DRIVE = np.arange(8.0).reshape(1, 8)
CHANNEL = array_pb2.Channel(name="a", unit="m")
DESCRIPTION = rig_pb2.RigDescription(rig="r", sample_rate=100.0, drives=[CHANNEL], responses=[CHANNEL])


@pytest.fixture
def correct(monkeypatch):
    """Return a function that corrects a drive by a campaign with the given end; playback n has n times the drive."""
    asked = []
    parent = iterator_pb2.CampaignSpec(rig="r", update={"kind": iterator_pb2.UPDATE_KIND_SECANT})
    parent.update.iteration_gain.CopyFrom(to_array(np.ones(1)))
    monkeypatch.setattr(iterate_again, "_specification", lambda *_: parent)
    played = [to_record([CHANNEL], 100.0, n * DRIVE) for n in range(1, 4)]
    steps = [iterator_pb2.IterationStep(iteration=n, drive=each, response=each) for n, each in enumerate(played, 1)]
    stored = [(step, recorder_pb2.RecordedStep()) for step in steps]
    started = []
    monkeypatch.setattr(iterate_again, "_steps", lambda *_, **__: [*started[-1:], *stored])

    def corrected(status, *, response, weights=None, limit=np.inf):
        if weights is not None:
            parent.target.channels.extend([array_pb2.Channel(name=name, unit="N") for name in "ab"])
            parent.update.weights.CopyFrom(to_array(np.array(weights)))
            parent.update.iteration_gain.CopyFrom(to_array(np.ones(2)))

        def query(key, message, _answer):
            asked.append(key)
            if isinstance(message, iterator_pb2.CampaignSpec):
                started.append((message, recorder_pb2.RecordedStep()))
            return status

        bus = SimpleNamespace(keys=Keys(), query=query)
        return iterate_again.corrected_drive(
            bus,
            DRIVE,
            response=response,
            parent="parent",
            corrected_by="",
            id="again",
            description=DESCRIPTION,
            playbacks=3,
            passed_limit=lambda new, *, present: "too far" if new.max() > max(limit, present.max()) else "",
            stop=threading.Event(),
            on_activity=lambda _: None,
        )

    corrected.asked = asked
    return corrected


def test_a_drive_is_replaced_by_a_better_one_only(correct):
    better = correct(finished(0.2, 0.11, best=2, first=0.117), response=DRIVE)
    np.testing.assert_array_equal(better, 2.0 * DRIVE)
    with pytest.raises(FaultError, match=r"no playback was better; the drive stays.* is 0\.117, .* playback 0\.197:"):
        correct(finished(0.25, 0.197, best=2, first=0.117), response=DRIVE)
    with pytest.raises(FaultError, match="no playback was better"):
        correct(finished(0.117, best=1, first=0.117), response=DRIVE)


def test_a_present_drive_that_is_played_once_more_competes_as_the_first_playback(correct):
    np.testing.assert_array_equal(correct(finished(0.117, 0.1, best=2), response=None), 2.0 * DRIVE)
    with pytest.raises(FaultError, match="no playback was better"):
        correct(finished(0.117, 0.2, best=1), response=None)
    # After the outcome "reached" the last playback counts as the best one.
    with pytest.raises(FaultError, match="no playback was better"):
        correct(finished(0.1, 0.12, best=2), response=None)


def test_a_correction_without_a_best_playback_leaves_the_drive(correct):
    with pytest.raises(FaultError, match="'again' has 1 playbacks and no best one; the drive stays"):
        correct(finished(0.1, best=0, first=0.2), response=DRIVE)


def test_the_best_playback_is_chosen_with_the_weights_of_the_campaign(correct):
    # Over both channels alike, playback 1 has the smallest error; with three times the weight on a, playback 2.
    ended = finished((0.2, 0.1), (0.1, 0.22), (0.3, 0.3), best=1, first=(0.4, 0.4))
    np.testing.assert_array_equal(correct(ended, response=DRIVE, weights=[3.0, 1.0]), 2.0 * DRIVE)


def test_equal_weights_choose_as_the_campaign_does(correct):
    ended = finished((0.2, 0.1), (0.1, 0.22), best=1, first=(0.4, 0.4))
    np.testing.assert_array_equal(correct(ended, response=DRIVE, weights=[3.0, 3.0]), DRIVE)


def test_a_playback_that_is_better_in_a_channel_of_little_weight_only_leaves_the_drive(correct):
    ended = finished((0.21, 0.1), best=1, first=(0.2, 0.3))
    with pytest.raises(FaultError, match=r"no playback was better.*, with the campaign's weights, is 0\.203, .* 0"):
        correct(ended, response=DRIVE, weights=[3.0, 0.5])


def test_after_the_target_was_reached_the_last_playback_is_taken(correct):
    ended = finished((0.1, 0.3), (0.2, 0.2), best=2, first=(0.4, 0.4))
    ended.outcome = iterator_pb2.OUTCOME_REACHED
    np.testing.assert_array_equal(correct(ended, response=DRIVE, weights=[3.0, 1.0]), 2.0 * DRIVE)


def test_a_monitored_response_has_no_part_in_the_choice(correct):
    ended = finished((0.2, np.nan), (0.1, np.nan), best=2, first=(0.4, np.nan))
    for metrics in (*ended.iterations, ended.first_drive):
        metrics.overall_relative_rms_error = metrics.channels[0].relative_rms_error
    np.testing.assert_array_equal(correct(ended, response=DRIVE, weights=[3.0, 0.0]), 2.0 * DRIVE)


@pytest.mark.parametrize(
    ("response", "limit", "number"), [(DRIVE, 8.0, 2), (DRIVE, 15.0, 3), (None, 1.0, 2), (2.0 * DRIVE, 1.0, 3)]
)
def test_a_playback_beyond_an_abort_limit_of_the_schedule_stops_the_campaign(correct, response, limit, number):
    running = finished(0.3, 0.2, 0.1, best=3, first=0.4)
    running.phase = iterator_pb2.CAMPAIGN_PHASE_ITERATING
    sentence = rf"'again' playback {number} passed an abort limit of the schedule \(too far\); the drive stays"
    with pytest.raises(FaultError, match=sentence):
        correct(running, response=response, limit=limit)
    assert correct.asked[-1].endswith("again/stop")


def test_a_recorder_that_is_away_for_a_moment_delays_the_check_of_the_limits(correct, monkeypatch):
    monkeypatch.setattr(iterate_again, "_POLL_SECONDS", 0.01)
    recorded, away = iterate_again._steps, [True, True]

    def steps(*names, **how):
        if away and away.pop():
            raise FaultError(query_pb2.FAULT_CODE_UNAVAILABLE, "No recorder is on the bus.")
        return recorded(*names, **how)

    monkeypatch.setattr(iterate_again, "_steps", steps)
    running = finished(0.3, 0.2, 0.1, best=3, first=0.4)
    running.phase = iterator_pb2.CAMPAIGN_PHASE_ITERATING
    with pytest.raises(FaultError, match="playback 2 passed an abort limit"):
        correct(running, response=DRIVE, limit=8.0)
    away[:] = [True]
    with pytest.raises(FaultError, match="No recorder is on the bus"):
        correct(finished(0.3, 0.2, best=2, first=0.4), response=DRIVE)
