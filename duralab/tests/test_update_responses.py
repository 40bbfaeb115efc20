"""Gains, weights and watched responses of a campaign file, as the iterator gets them."""

import numpy as np
import pytest
from test_campaign_file import CONTENT
from test_target import RIG

from duralab.campaign import update_message
from duralab.data import Rig, Signals
from duralab.errors import InputError
from duralab.target.measured import map_channels
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import array_pb2, rig_pb2
from duralab_settings import UpdateSection

NAMES = ("left_vertical", "left_lateral", "right_vertical")
WIDE = Rig.from_message(
    rig_pb2.RigDescription(
        rig="wide",
        sample_rate=1000.0,
        drives=[array_pb2.Channel(name=name, unit="m", minimum=-0.1, maximum=0.1) for name in NAMES[:2]],
        responses=[array_pb2.Channel(name=name, unit="N", minimum=-1e4, maximum=1e4) for name in NAMES],
        static_response=to_array(np.zeros(3)),
    )
)


def update(**settings):
    return UpdateSection.model_validate({**CONTENT["update"], **settings})


def test_groups_weights_and_watched_responses_reach_the_iterator():
    section = update(
        iteration_gain=0.8,
        watch=["left_lateral"],
        groups={"verticals": {"channels": ["left_vertical", "right_vertical"], "iteration_gain": 0.4, "weight": 2.0}},
    )
    message = update_message(section, rig=WIDE)
    np.testing.assert_array_equal(from_array(message.iteration_gain), [0.4, 0.8, 0.4])
    np.testing.assert_array_equal(from_array(message.weights), [2.0, 0.0, 2.0])
    by_name = update(iteration_gain={"left_lateral": 0.3}, groups=section.groups, weights={"left_lateral": 0.5})
    resolved = by_name.resolved(NAMES, drives=2)
    assert (resolved.iteration_gain, resolved.weights) == ((0.4, 0.3, 0.4), (2.0, 0.5, 2.0))


def test_without_weights_nothing_is_said_of_them():
    assert not update_message(update(), rig=RIG).HasField("weights")


@pytest.mark.parametrize(
    ("settings", "field", "sentence"),
    [
        ({"watch": ["rear"]}, "update.watch", "unknown channel rear"),
        ({"weights": {"rear": 1.0}}, "update.weights", "unknown channel rear"),
        ({"groups": {"a": {"channels": ["rear"], "iteration_gain": 0.5}}}, "update.groups", "unknown channel rear"),
        ({"watch": ["left_vertical", "left_lateral"]}, "update.watch", "leaves 1 of 3 responses"),
    ],
)
def test_what_does_not_fit_the_rig_is_refused_with_its_key(settings, field, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        update_message(update(**settings), rig=WIDE)
    assert caught.value.field == field


@pytest.mark.parametrize(
    "settings",
    [
        {"watch": ["left_vertical"], "weights": {"left_vertical": 1.0}},
        {"groups": {"a": {"channels": ["x"], "iteration_gain": 0.5}, "b": {"channels": ["x"], "iteration_gain": 0.6}}},
        {"weights": {"x": 1.0}, "groups": {"a": {"channels": ["x"], "weight": 2.0}}},
        {"groups": {"a": {"channels": ["x"]}}},
        {"weights": {"x": 0.0}},
    ],
)
def test_what_contradicts_itself_is_refused(settings):
    with pytest.raises(ValueError, match=r"twice|neither iteration_gain nor weight|greater than 0"):
        update(**settings)


def test_a_watched_response_may_lack_a_target_and_no_other_may():
    given = Signals(WIDE.responses[1:], 1000.0, np.ones((2, 20)))
    found = map_channels(given, rig=WIDE, source="file x", remedy="", watched=("left_vertical",))
    np.testing.assert_array_equal(found.samples.mean(axis=1), [0.0, 1.0, 1.0])
    with pytest.raises(InputError, match="lacks left_vertical"):
        map_channels(given, rig=WIDE, source="file x", remedy="")
