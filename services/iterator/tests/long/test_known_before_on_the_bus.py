"""A campaign with a stored model and what others learned: refused where it does not fit, resumed to the same bytes."""

import time
from contextlib import suppress

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.arrays import from_array, to_array
from duralab_proto.contents import content_hash
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2

from ..killable_lab import killable_lab, killed_at, playbacks, resumed
from ..linear_rig import exact_model, experiment_plan, specification

ITERATIONS = 2
HOUR = 3_600_000_000_000
# Specification, rig, target, model; for each playback: planned, result, played; status, end.
STEPS = 4 + 3 * ITERATIONS + 2


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    with killable_lab("iterator_known_test", tmp_path_factory.mktemp("lab"), {"front": 0.1, "rear": 0.1}) as lab:
        lab.start(specification("first", iterations=ITERATIONS))
        assert lab.end_of("first").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
        yield lab


def stored_model(spec, *, change=None):
    request = identifier_pb2.IdentifyRequest(rig=spec.rig, run="old.identify", estimator=spec.estimator)
    request.excitation.CopyFrom(spec.excitation)
    model = exact_model(request)
    model.plan.CopyFrom(experiment_plan(request))
    model.estimator.CopyFrom(spec.estimator)
    if change is not None:
        change(model)
    model.id = content_hash(model)
    return model


def knowing(id, *, change=None, **settings):
    spec = specification(id, iterations=ITERATIONS, samples=6000, **settings)
    spec.known.model.CopyFrom(stored_model(spec, change=change))
    spec.known.model_source = "old"
    spec.known.model_time = time.time_ns() - 5 * HOUR
    spec.known.learn_from.append("first")
    return spec


def test_with_a_stored_model_nothing_is_identified_and_the_recording_holds_it(lab):
    identified = set(lab.identifier.requests)
    lab.start(knowing("known"))
    assert lab.end_of("known").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    assert set(lab.identifier.requests) == identified
    kinds = lab.recorder.kinds("known")
    assert len(kinds) == STEPS
    assert kinds[:4] == ["CampaignSpec", "RigDescription", "TargetInBand", "Model"]
    (model,) = lab.recorder.read("known", identifier_pb2.Model)
    assert model.run == "old.identify"
    runs = [run.run for run in lab.recorder.read("known", recorder_pb2.RunPlanned)]
    assert runs == [f"known.i{number:02d}" for number in (1, 2)]
    # The specimen bore that identification once, in its own campaign.
    for step in lab.recorder.read("known", iterator_pb2.IterationStep):
        assert all(set(channel.identification_damage) == {0.0} for channel in step.metrics.channels)


def test_killed_at_any_step_it_ends_with_the_same_bytes(lab):
    lab.start(knowing("whole"))
    assert lab.end_of("whole").phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED
    for attempt, step in enumerate((0, 2, 3, 5, 7)):
        id = f"killed-{attempt}"
        with killed_at(lab, id, step, stored=True, later=0.0) as killed:
            with suppress(FaultError):
                lab.start(knowing(id))
            assert killed.wait(20.0)
        lab.iterator.end()
        lab.iterator.start()
        lab.iterator.wait()
        resumed(lab, id)
        assert lab.end_of(id).phase == iterator_pb2.CAMPAIGN_PHASE_FINISHED, step
        assert playbacks(lab, id) == playbacks(lab, "whole"), step


def test_the_status_has_the_error_of_a_first_drive_with_a_response_to_this_target(lab):
    lab.start(knowing("seen"))
    assert not lab.end_of("seen").HasField("first_drive")
    # A rig without signal blocks: the steps hold the samples.
    seen = lab.recorder.read("seen", iterator_pb2.IterationStep)[0]
    spec = knowing("again")
    first = spec.known.first_drive
    first.drive.CopyFrom(seen.drive)
    first.response.CopyFrom(seen.response)
    first.of_this_target = True
    lab.start(spec)
    ended = lab.end_of("again")
    assert ended.first_drive.overall_relative_rms_error == seen.metrics.overall_relative_rms_error
    errors = [channel.relative_rms_error for channel in seen.metrics.channels]
    assert [channel.relative_rms_error for channel in ended.first_drive.channels] == errors
    assert [metrics.iteration for metrics in ended.iterations] == [1, 2]


def of_another_rig(spec):
    spec.known.model.CopyFrom(stored_model(spec, change=lambda model: setattr(model, "rig_content_hash", "another")))


def too_old(spec):
    spec.known.largest_model_age = 2.0


def of_no_age(spec):
    spec.known.largest_model_age, spec.known.model_time = 2.0, 0


def too_narrow(spec):
    spec.known.model.CopyFrom(stored_model(spec, change=lambda model: setattr(model.plan, "highest_frequency", 40.0)))


def damaged(spec):
    spec.known.model.run = "another"


def unknown_campaign(spec):
    spec.known.learn_from.append("nobody")


def other_estimator(spec):
    spec.estimator.block_samples *= 2


def short_drive(spec):
    spec.known.first_drive.drive.CopyFrom(spec.target)
    spec.known.first_drive.drive.channels[0].name = "left"


def long_drive(spec):
    description = spec.known.model
    record = spec.known.first_drive.drive
    record.channels.extend(description.drives)
    record.sample_rate = spec.target.sample_rate
    record.samples.CopyFrom(to_array(np.zeros((2, from_array(spec.target.samples).shape[1] + 1))))


def no_response(spec):
    spec.known.first_drive.of_this_target = True
    record = spec.known.first_drive.drive
    record.channels.extend(spec.known.model.drives)
    record.sample_rate = spec.target.sample_rate
    record.samples.CopyFrom(to_array(np.zeros((2, from_array(spec.target.samples).shape[1]))))


@pytest.mark.parametrize(
    ("spoil", "field", "sentence"),
    [
        (
            of_another_rig,
            "known.model",
            r"content hash another, and rig 'front' has linear: only a model of this very rig",
        ),
        (
            too_old,
            "known.model",
            r"is 5\.0 hours old, and start_from\.model_age allows 2 hours; identify the rig again",
        ),
        (of_no_age, "known.model", r"does not state when it was identified"),
        (too_narrow, "highest_frequency", r"40 Hz"),
        (damaged, "known.model", r"its id is not the hash of its content"),
        (unknown_campaign, "known.learn_from", r"names 'nobody', of which the recorder holds no recording"),
        (other_estimator, "estimator", r"was estimated with other settings"),
        (short_drive, "known.first_drive.drive", r"must have left, right"),
        (long_drive, "known.first_drive.drive", r"has 6001 samples; the target has 6000"),
        (no_response, "known.first_drive.of_this_target", r"needs a response and no levels"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_is_stored(lab, spoil, field, sentence):
    spec = knowing("refused")
    spoil(spec)
    with pytest.raises(FaultError, match=sentence) as caught:
        lab.start(spec)
    assert caught.value.field == field
    assert caught.value.code in (query_pb2.FAULT_CODE_INVALID_ARGUMENT, query_pb2.FAULT_CODE_FAILED_PRECONDITION)
    assert "refused" not in lab.recorder.steps
