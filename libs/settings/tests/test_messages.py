"""Every field of every settings message has its field in the model, and the other way round."""

import math
import typing
from enum import Enum

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from duralab_proto.arrays import to_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2
from duralab_settings import (
    Acceptance,
    AtTarget,
    ControlBandSettings,
    DamageExponent,
    Decision,
    DecisionKind,
    DriveMapSettings,
    EstimatorSettings,
    HoldPoint,
    HoldSettings,
    PlaybackSettings,
    ResolvedExcitation,
    ResolvedUpdate,
    SecantSettings,
    Section,
    SettingsError,
    Spectrum,
    StopCriteria,
    TabulatedSpectrum,
    UpdateKind,
    UpdatePlugin,
    UpdateSection,
    WhitePinkSpectrum,
)
from duralab_settings.messages import LARGEST_ARRAY, fill_message, from_message, message_fields

WHOLE = {
    ResolvedExcitation: identifier_pb2.Excitation,
    WhitePinkSpectrum: identifier_pb2.WhitePinkSpectrum,
    TabulatedSpectrum: identifier_pb2.TabulatedSpectrum,
    Spectrum: identifier_pb2.Spectrum,
    EstimatorSettings: identifier_pb2.Estimator,
    ResolvedUpdate: iterator_pb2.UpdateSettings,
    SecantSettings: iterator_pb2.SecantSettings,
    UpdatePlugin: iterator_pb2.UpdatePlugin,
    DriveMapSettings: iterator_pb2.DriveMapSettings,
    StopCriteria: iterator_pb2.StopCriteria,
    Acceptance: iterator_pb2.Acceptance,
    AtTarget: iterator_pb2.AtTarget,
    HoldSettings: iterator_pb2.HoldSettings,
}
"""Models whose messages hold nothing else."""
PARTS = {
    PlaybackSettings: iterator_pb2.CampaignSpec,
    ControlBandSettings: iterator_pb2.CampaignSpec,
    Decision: iterator_pb2.Decision,
}
NO_SETTINGS = {"Record", "Array", "TargetStep", "DriveMapRequest", "TargetShape", "KnownBefore"}
"""Messages in a specification that hold signals and what was done with them, or figures that were found before."""

PINK = {"lowest_frequency": 1.0, "highest_frequency": 50.0, "corner_frequency": 5.0, "decibels_per_octave": 3.0}


def settings_messages():
    """Yield the descriptors of all messages that a request holds settings in, nested ones too."""
    found, left = {}, [iterator_pb2.CampaignSpec, iterator_pb2.ResumeCampaignRequest, identifier_pb2.IdentifyRequest]
    left = [message.DESCRIPTOR for message in left]
    roots = set(left)
    while left:
        message = left.pop()
        found[message.name] = message
        nested = [field.message_type for field in message.fields if field.message_type is not None]
        left += [each for each in nested if each.name not in NO_SETTINGS | found.keys()]
    return [message for message in found.values() if message not in roots]


def test_every_settings_message_has_its_model():
    assert {message.name for message in settings_messages()} == {each.DESCRIPTOR.name for each in WHOLE.values()}


@pytest.mark.parametrize(("model", "message"), WHOLE.items())
def test_fields_of_model_and_message_are_the_same(model, message):
    stood_for = [field.name for name in model.model_fields for field in message_fields(message, name)]

    assert sorted(stood_for) == sorted(message.DESCRIPTOR.fields_by_name)


@pytest.mark.parametrize(("model", "message"), PARTS.items())
def test_a_part_of_a_specification_has_its_fields_there(model, message):
    for name in model.model_fields:
        assert [field.name for field in message_fields(message, name)] == [name]


@pytest.mark.parametrize(("model", "message"), (WHOLE | PARTS).items())
def test_every_enum_of_a_model_has_the_names_of_the_message(model, message):
    for name, info in model.model_fields.items():
        (field, *_) = message_fields(message, name)
        if field.enum_type is not None:
            prefix = field.enum_type.values_by_number[0].name.removesuffix("UNSPECIFIED")
            names = {value.name.removeprefix(prefix) for value in field.enum_type.values if value.number}
            assert names == {member.name for member in info.annotation}


def test_a_model_with_a_field_that_its_message_lacks_is_found():
    with pytest.raises(LookupError, match="StopCriteria has neither patience nor smallest_patience"):
        message_fields(iterator_pb2.StopCriteria, "patience")


def values(annotation, metadata=()):
    """Strategy for a value of a field by its type and bounds."""
    if typing.get_origin(annotation) is typing.Annotated:
        inner, *more = typing.get_args(annotation)
        for each in more:
            metadata = (*metadata, *getattr(each, "metadata", (each,)))
        return values(inner, metadata)
    bounds = {type(each).__name__.lower(): each for each in metadata}
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return st.sampled_from(annotation)
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return instances(annotation)
    if annotation is bool:
        return st.booleans()
    if annotation is str:
        return st.text("AZ az09_", min_size=1, max_size=20).filter(str.strip)
    if annotation is int:
        step = bounds["multipleof"].multiple_of if "multipleof" in bounds else 1
        least = -(-bounds["ge"].ge // step)
        most = bounds["le"].le if "le" in bounds else bounds["lt"].lt - 1 if "lt" in bounds else 2**16
        return st.integers(least, most // step).map(lambda number: number * step)
    if annotation is float:
        low = bounds["gt"].gt if "gt" in bounds else bounds["ge"].ge
        high = bounds["le"].le if "le" in bounds else bounds["lt"].lt if "lt" in bounds else 1e9
        return st.floats(low, high, exclude_min="gt" in bounds, exclude_max="lt" in bounds)
    if type(None) in typing.get_args(annotation):
        (inner,) = [each for each in typing.get_args(annotation) if each is not type(None)]
        return st.none() | values(inner, metadata)
    inner, *more = typing.get_args(annotation)
    if more and more[0] is not Ellipsis:
        return st.tuples(*(values(each) for each in (inner, *more)))
    least = bounds["minlen"].min_length if "minlen" in bounds else 0
    return st.lists(values(inner), min_size=least, max_size=4).map(tuple)


def bands():
    return st.tuples(st.floats(1e-3, 1.0), st.floats(1.0, 10.0), st.floats(10.1, 1e3)).map(
        lambda found: dict(zip(("lowest_frequency", "corner_frequency", "highest_frequency"), found, strict=True))
    )


def consistent(model, found, draw):
    """Make what was drawn for single fields fit together, where the model asks for it."""
    if model is WhitePinkSpectrum:
        found |= draw(bands())
    if model is Spectrum:
        table = {"frequency": (1.0, 50.0), "density": draw(st.tuples(*[st.floats(1e-6, 1e6)] * 2))}
        found = draw(
            st.sampled_from([{"white_pink": WhitePinkSpectrum(**PINK)}, {"table": TabulatedSpectrum(**table)}])
        )
    if model is TabulatedSpectrum:
        rising = sorted({*found["frequency"], 1e10, 1e11})
        found = {"frequency": tuple(rising), "density": (1.0,) * len(rising)}
    if model is ResolvedExcitation:
        levels = found["rms"] or found["peak"] or (1.0,)
        found |= {"rms": None, "peak": None, draw(st.sampled_from(["rms", "peak"])): levels}
        if draw(st.booleans()):
            found |= {"spectrum": WhitePinkSpectrum(**PINK), "drive_spectra": ()}
        else:
            found |= {"spectrum": None, "drive_spectra": tuple(draw(instances(Spectrum)) for _ in levels)}
        # Half of the shortest float rounds to the whole of it.
        found["duration"] = max(found["duration"], 1e-300)
        found["fade"] = found["duration"] * draw(st.floats(0.0, 0.49))
        if not found["kind"].is_multisine:
            found |= {"odd_lines": False, "detection_share": 0.0, "minimise_crest_factor": False}
    if model is ResolvedUpdate:
        responses = len(found["iteration_gain"])
        points = sorted(set(found["gain_curve_frequency"] or ()))
        found["gain_curve_frequency"] = tuple(points) or None
        shares = tuple((draw(st.floats(0.01, 1.0)),) * responses for _ in points)
        found["gain_curve_share"] = shares or None
        found["weights"] = draw(st.none() | st.tuples(*[st.floats(0.0, 10.0)] * responses))
    if model is UpdatePlugin:
        beta = draw(st.floats(0.0, 1.0))
        found = {"name": draw(st.sampled_from(["momentum", "a-1_B"])), "settings": {"beta": beta}}
    if model is StopCriteria:
        ratios = st.tuples(st.floats(0.0, 0.99), st.floats(1.01, 100.0))
        found |= {
            "damage_ratio": draw(st.none() | ratios),
            "divergence_ratio": draw(st.just(0.0) | st.floats(1.01, 9.0)),
        }
    if model is Acceptance:
        ratios = st.none() | st.tuples(st.floats(0.0, 0.99), st.floats(1.01, 100.0))
        found |= {"peak_ratio": draw(ratios), "damage_ratio": draw(ratios)}
        found["energy_outside_band"] = found["energy_outside_band"] or 0.0
    if model is PlaybackSettings:
        found["levels"] = (*sorted(found["levels"]), 1.0) if found["levels"] else ()
    if model is ControlBandSettings:
        band = draw(bands())
        found |= {"lowest_frequency": band["lowest_frequency"], "highest_frequency": band["highest_frequency"]}
        found["lower_flank"] = draw(st.none() | st.just(band["lowest_frequency"] / 2))
    if model is HoldSettings:
        bounds = ("predicted_peak", "predicted_damage")
        if found["when"] is not HoldPoint.PREDICTED:
            found |= dict.fromkeys(bounds)
        elif all(found[key] is None for key in bounds):
            found["predicted_peak"] = 1.2
    if model is Decision:
        changes = found["kind"] is DecisionKind.CHANGE
        found |= {"update": draw(instances(ResolvedUpdate)) if changes else None}
        found |= {} if changes else {"control_band": None, "scenario": ""}
        found["from_iteration"] = 3 if found["kind"] is DecisionKind.BACK else 0
    return found


@st.composite
def instances(draw, model):
    """Settings of a model whose fields are drawn by their types, so that a new field is drawn without a word here."""
    found = {name: draw(values(info.annotation, tuple(info.metadata))) for name, info in model.model_fields.items()}
    return model(**consistent(model, found, draw))


@pytest.mark.parametrize(("model", "message"), (WHOLE | PARTS).items())
def test_nothing_is_lost_on_the_way_through_a_message(model, message):
    @given(instances(model))
    def round_trip(settings):
        sent = message()
        fill_message(sent, settings)
        assert from_message(message.FromString(sent.SerializeToString()), model) == settings

    round_trip()


def test_zeros_of_a_message_stand_for_what_the_contract_says():
    stop = from_message(iterator_pb2.StopCriteria(iterations=3), StopCriteria)
    assert stop == StopCriteria(iterations=3)
    assert (stop.error_bound, stop.peak_bound, stop.damage_bound) == (3.0, 3.0, 250.0)
    assert (stop.improvement_playbacks, stop.damage_exponent) == (2, DamageExponent.FIVE)

    excitation = identifier_pb2.Excitation(kind="EXCITATION_KIND_PURE_RANDOM", duration=10.0)
    excitation.rms.CopyFrom(to_array(np.ones(2)))
    fill_message(excitation.spectrum, WhitePinkSpectrum(**PINK))
    found = from_message(excitation, ResolvedExcitation)
    assert (found.delay_blocks, found.capture_blocks, found.repeats, found.realisations) == (1, 1, 1, None)
    assert found.burst_share == 0.5

    playbacks = from_message(iterator_pb2.CampaignSpec(), PlaybackSettings)
    assert (playbacks.limit_policy.value, playbacks.largest_overrun) == ("refuse", 1.25)


def test_no_bound_is_infinite_in_the_message():
    message = iterator_pb2.StopCriteria()
    fill_message(message, StopCriteria(iterations=3, error_bound=None))

    assert message.error_bound == math.inf
    assert from_message(message, StopCriteria).error_bound is None


def update(**changes):
    message = iterator_pb2.UpdateSettings(kind="UPDATE_KIND_BASIC_TWR", **changes)
    if not message.HasField("iteration_gain"):
        message.iteration_gain.CopyFrom(to_array(np.ones(2)))
    return message


def test_bounds_of_a_correction_may_be_left_out_where_nothing_is_corrected():
    assert from_message(update(), ResolvedUpdate, field="update").smallest_correction == 0.5

    adaptive = update()
    adaptive.kind = iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING
    with pytest.raises(
        SettingsError, match=r"update\.smallest_correction is 0\.0; it must be greater than 0"
    ) as caught:
        from_message(adaptive, ResolvedUpdate, field="update")
    assert caught.value.field == "update.smallest_correction"


@pytest.mark.parametrize(
    ("message", "field", "sentence"),
    [
        (update(prediction=9), "update.prediction", r"is 9; offered are FORWARD \(1\), BACKWARD \(2\)\.$"),
        (update(gain_schedule=[0.5, 1.5]), "update.gain_schedule.1", "is 1.5; it must be less than or equal to 1"),
        (update(iteration_gain=to_array(np.ones((2, 2)))), "update.iteration_gain", r"the shape \(2, 2\); it must be"),
        (update(iteration_gain=to_array(np.array([1.0, np.nan]))), "update.iteration_gain", "must be finite"),
        (
            update(iteration_gain=to_array(np.ones(LARGEST_ARRAY + 1))),
            "update.iteration_gain",
            "has 100001 values; at most 100000 are allowed",
        ),
        (update(weights=to_array(np.ones(3))), "update.weights", "has 3 weights and 2 iteration gains"),
        (
            update(gain_curve_frequency=to_array(np.ones(1))),
            "update.gain_curve_frequency",
            "has only one of gain_curve_frequency and gain_curve_share; give both or none",
        ),
        (
            update(secant=iterator_pb2.SecantSettings(prior_strength=1.0)),
            "update.secant.forgetting",
            "is 0.0; it must be greater than or equal to 0.001",
        ),
    ],
)
def test_a_refusal_names_the_field_the_value_and_what_is_allowed(message, field, sentence):
    with pytest.raises(SettingsError, match=sentence) as caught:
        from_message(message, ResolvedUpdate, field="update")

    assert caught.value.field == field
    assert str(caught.value).startswith(field.rpartition(".")[0])


def test_a_kind_that_is_not_given_is_refused():
    with pytest.raises(SettingsError, match=r"^estimator.kind is 0; offered are H1 \(1\), H2 \(2\)"):
        from_message(identifier_pb2.Estimator(block_samples=512), EstimatorSettings, field="estimator")

    assert from_message(update(), ResolvedUpdate).kind is UpdateKind.BASIC_TWR


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"name": "a b"}, "plugin.name is 'a b'; it must match"),
        ({"name": "a", "settings": [1]}, "plugin.settings is [1]; give names with values."),
        ({"name": "a", "settings": {"x": math.nan}}, "plugin.settings cannot be written as JSON: Out of range"),
        ({"name": "a", "settings": "{"}, "plugin.settings cannot be written as JSON: Expecting property name"),
    ],
)
def test_a_plugin_whose_settings_are_no_json_object_is_refused(settings, said):
    with pytest.raises(SettingsError) as caught:
        UpdateSection(iteration_gain=0.5, plugin=settings)
    assert str(caught.value).startswith(said)


def test_segments_are_accepted_for_the_secant_update_alone_where_nothing_is_said():
    assert UpdateSection(iteration_gain=0.5).accepts_segments
    assert not UpdateSection(iteration_gain=0.5, plugin={"name": "momentum"}).accepts_segments
