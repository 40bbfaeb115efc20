"""The words of a report about how drives were made, against the specification they come from."""

import numpy as np
import pytest
import synthetic_campaign

from duralab.report.provenance import method_in_words
from duralab_proto.arrays import to_array
from duralab_proto.v1 import iterator_pb2


@pytest.fixture
def specification():
    return synthetic_campaign.specification(np.zeros((6, 200)))


def told(specification):
    return dict(method_in_words(specification))


def test_adaptive_modelling_is_told_with_its_bounds(specification):
    assert told(specification)["Update"] == (
        "Adaptive Modelling, forward prediction, diagonal correction of 0.5 to 2, weighed by coherence above 0.7, "
        "gain 0.7"
    )
    specification.update.weigh_by_coherence = False
    specification.update.correction = iterator_pb2.CORRECTION_SHAPE_FULL
    specification.update.prediction = iterator_pb2.CORRECTION_PREDICTION_BACKWARD
    assert told(specification)["Update"].startswith(
        "Adaptive Modelling, backward prediction, full correction of 0.5 to 2, gain"
    )


def test_secant_update_is_told_with_schedule_curve_and_acceptance(specification):
    update = specification.update
    update.kind = iterator_pb2.UPDATE_KIND_SECANT
    update.iteration_gain.CopyFrom(to_array(np.ones(6)))
    update.gain_schedule.extend([0.7, 0.8, 0.9, 1.0])
    update.gain_curve_frequency.CopyFrom(to_array(np.array([1.0, 30.0])))
    update.gain_curve_share.CopyFrom(to_array(np.ones((2, 6))))
    update.accept_segments = True
    assert told(specification)["Update"] == (
        "secant update, gain 1, times 0.7, 0.8, 0.9, 1 for the first drive, the second and so on, times a curve of 2 "
        "points over 1 to 30 Hz, each stretch from its best so far"
    )
    update.secant.CopyFrom(
        iterator_pb2.SecantSettings(forgetting=0.7, prior_strength=1.0, caution=1.0, regularisation=1e-5)
    )
    assert (
        "secant update, forgetting 0.7, prior strength 1, caution 1, regularisation 1e-05, gain 1"
        in (told(specification)["Update"])
    )
    update.secant.odd_terms = True
    assert "regularisation 1e-05, odd terms, gain 1" in told(specification)["Update"]
    update.secant.rate_limits = True
    assert "regularisation 1e-05, odd terms, rate limits, gain 1" in told(specification)["Update"]


@pytest.mark.parametrize(
    ("settings", "words"), [("", ""), ('{"beta": 0.1, "steps": [1, 2]}', "beta 0.1, steps [1, 2], "), ("[", "[, ")]
)
def test_an_update_of_a_plugin_is_named_with_its_settings(specification, settings, words):
    specification.update.kind = iterator_pb2.UPDATE_KIND_SECANT
    specification.update.plugin.CopyFrom(iterator_pb2.UpdatePlugin(name="momentum", settings=settings))
    assert told(specification)["Update"] == f"plug-in momentum, {words}gain 0.7"


def test_gains_are_told_by_channel_where_they_differ(specification):
    specification.update.iteration_gain.CopyFrom(to_array(np.array([0.5, 0.7, 0.7, 0.7, 0.7, 0.7])))
    names = [channel.name for channel in specification.target.channels]
    assert f"gain of {names[0]} 0.5, {names[1]} 0.7, " in told(specification)["Update"]


def test_levels_weights_and_limits_are_told_where_they_are_set(specification):
    assert not {"Levels", "Weights", "Watched, not controlled"} & set(told(specification))
    names = [channel.name for channel in specification.target.channels]
    specification.levels.extend([0.5, 0.75, 1.0])
    specification.update.weights.CopyFrom(to_array(np.array([1.0, 2.0, 1.0, 0.0, 1.0, 0.0])))
    specification.limit_policy = iterator_pb2.LIMIT_POLICY_REFUSE
    rows = told(specification)
    assert rows["Levels"] == "0.5, 0.75, 1 of the target in the first playbacks, then all of it"
    assert rows["Watched, not controlled"] == f"{names[3]}, {names[5]}"
    assert rows["Weights"] == f"{names[0]} 1, {names[1]} 2, {names[2]} 1, {names[4]} 1"
    assert rows["At a limit of the rig"] == "the campaign ends before the drive is played"


def test_bounds_of_a_playback_and_of_the_first_drive_are_told_where_they_are_set(specification):
    before = told(specification)
    assert "passes" not in before["End"]
    specification.limit_policy = iterator_pb2.LIMIT_POLICY_PROJECT
    specification.largest_overrun = 1.25
    specification.stop.error_bound, specification.stop.peak_bound, specification.stop.damage_bound = 3.0, np.inf, 250.0
    rows = told(specification)
    assert rows["End"] == (
        f"{before['End']}, or where a channel passes a relative RMS error of 3 or 250 × the target's damage "
        "in a playback"
    )
    assert rows["At a limit of the rig"] == (
        "a near drive that holds it is played, and each change is reported; a first drive beyond 1.25 × the limit is "
        "refused"
    )
