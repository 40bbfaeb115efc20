"""The identifier of a lab as a script asks it, with a bus that answers what it is told."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import synthetic_campaign
from test_campaign_file import CONTENT
from test_identification_section import RIG

from duralab.errors import InputError
from duralab.lab import Identifier
from duralab_proto.arrays import from_array, to_array
from duralab_proto.keys import Keys
from duralab_proto.v1 import identifier_pb2, query_pb2
from duralab_settings import EstimatorSettings, ExcitationSettings

KEYS = Keys("lab")
EXCITATION = ExcitationSettings.model_validate(CONTENT["excitation"])
ESTIMATOR = EstimatorSettings(block_samples=2048)


class Answers:
    """Keeps what was asked and answers a message."""

    def __init__(self, answer):
        self.answer, self.key, self.request = answer, None, None

    def __call__(self, key, request, _kind, on_progress=None, deadline=None, what=""):
        self.key, self.request = key, request
        if on_progress is not None:
            on_progress(query_pb2.Progress(phase="playing", fraction=0.5, remaining_seconds=3.0))
        return self.answer


def identifier(answers):
    return Identifier(SimpleNamespace(query=answers, bus=SimpleNamespace(keys=KEYS)), lambda _: RIG)


def message(factor):
    return identifier_pb2.Model(id=f"{factor:g}", **_content(synthetic_campaign.make(seconds=2.0, iterations=1).model))


def _content(model):
    return {field.name: value for field, value in model.ListFields() if field.name != "id"}


def test_a_series_of_levels_is_asked_for_and_answered_as_models_and_differences():
    difference = identifier_pb2.ModelDifference(
        relative_difference=to_array(np.full((3, 6), 0.2)),
        expected_by_noise=to_array(np.full((3, 6), 0.1)),
        sentences=["The models differ."],
    )
    answers = Answers(identifier_pb2.LevelsResult(models=[message(1), message(2)], differences=[difference]))
    told = []
    series = identifier(answers).levels(
        "front_axle", EXCITATION, ESTIMATOR, factors=[1, 0.1], seed=4, on_progress=told.append
    )
    assert answers.key == KEYS.identify_levels("front_axle")
    np.testing.assert_array_equal(from_array(answers.request.factors), [1.0, 0.1])
    assert (answers.request.identify.rig, answers.request.identify.rig_seed) == ("front_axle", 4)
    assert [model.id for model in series.models] == ["1", "2"]
    np.testing.assert_array_equal(series.differences[0].relative_difference, np.full((3, 6), 0.2))
    np.testing.assert_array_equal(series.differences[0].expected_by_noise, np.full((3, 6), 0.1))
    assert series.differences[0].sentences == ("The models differ.",)
    assert [(one.activity, one.fraction, one.remaining_seconds) for one in told] == [("playing", 0.5, 3.0)]


def test_a_spectrum_of_a_drive_that_the_rig_does_not_have_is_refused_before_anything_is_asked():
    wrong = ExcitationSettings.model_validate(
        {**CONTENT["excitation"], "drive_spectra": {"left_verticall": {"corner_frequency": 2.0}}}
    )
    answers = Answers(identifier_pb2.ExperimentPlan())
    with pytest.raises(InputError, match="unknown channel left_verticall; the drives are left_vertical, "):
        identifier(answers).plan("front_axle", wrong, ESTIMATOR)
    assert answers.key is None


def test_another_model_may_stand_for_the_rig():
    answers = Answers(
        identifier_pb2.Convergence(
            frequency=to_array(np.array([1.0])),
            spectral_radius=to_array(np.array([0.4])),
            spectral_radius_95=to_array(np.array([0.5])),
            largest_singular_value=to_array(np.array([0.6])),
            converging_share=1.0,
            sentence="It converges.",
        )
    )
    asked = identifier(answers)
    low, high = (asked_model(number) for number in (1, 2))
    assert asked.convergence(low, gain=0.6, band=(1.0, 2.0), rig_model=high).sentence == "It converges."
    assert (answers.key, answers.request.rig_model_id) == (KEYS.convergence("1"), "2")
    np.testing.assert_array_equal(from_array(answers.request.iteration_gain), np.full(6, 0.6))
    asked.convergence(low, gain=0.6, band=(1.0, 2.0))
    assert answers.request.rig_model_id == ""


def asked_model(number):
    return identifier(Answers(message(number))).identify("front_axle", EXCITATION, ESTIMATOR)


@pytest.mark.parametrize("learn", [True, False])
def test_a_drive_map_is_learned_where_it_is_asked_for(learn):
    answers = Answers(message(1.0))
    identifier(answers).identify("front_axle", EXCITATION, ESTIMATOR, learn_drive_map=learn)
    assert answers.request.HasField("drive_map") is learn
