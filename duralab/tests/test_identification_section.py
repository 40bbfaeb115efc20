"""The excitation and the estimator of a campaign file, and what becomes of them on the bus."""

import numpy as np
import pytest
from pydantic import ValidationError
from test_campaign_file import CONTENT, changed

from duralab.campaign import (
    build_specification,
    check_against_rig,
    estimator_message,
    excitation_message,
    load_campaign,
    parse_campaign,
    shipped_campaigns,
)
from duralab.data import Channel, Rig, Signals
from duralab.errors import InputError
from duralab.report.identification_words import identification_in_words
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, rig_pb2
from duralab_settings import EstimatorKind, EstimatorSettings, ExcitationKind, ExcitationSettings

NAMES = [f"{side}_{axis}" for side in ("left", "right") for axis in ("vertical", "lateral", "longitudinal")]
RIG = Rig.from_message(
    rig_pb2.RigDescription(
        rig="front_axle",
        sample_rate=1000.0,
        drives=[array_pb2.Channel(name=name, unit="m", minimum=-0.1, maximum=0.1) for name in NAMES],
        responses=[array_pb2.Channel(name=name, unit="N", minimum=-1e4, maximum=1e4) for name in NAMES],
        longest_drive_seconds=600.0,
        static_response=to_array(np.zeros(6)),
    )
)


def parsed_of(text):
    return parse_campaign(text, name="mine.yaml")


def excitation(**changes):
    return ExcitationSettings.model_validate({**CONTENT["excitation"], **changes})


def test_the_default_is_the_random_orthogonal_multisine_with_two_captures():
    parsed = parsed_of(changed("excitation.kind", None))
    message = excitation_message(parsed.excitation, rig=RIG, seed=3)
    assert message.kind == identifier_pb2.EXCITATION_KIND_RANDOM_ORTHOGONAL
    assert (message.delay_blocks, message.capture_blocks, message.repeats, message.realisations) == (1, 2, 1, 0)
    assert estimator_message(parsed.estimator).kind == identifier_pb2.ESTIMATOR_KIND_H1


@pytest.mark.parametrize("kind", list(ExcitationKind))
def test_every_excitation_reaches_the_bus_and_has_words(kind):
    message = excitation_message(excitation(kind=kind), rig=RIG, seed=3)
    assert identifier_pb2.ExcitationKind.Name(message.kind) == f"EXCITATION_KIND_{kind.name}"
    assert "unknown" not in identification_in_words(message, identifier_pb2.Estimator(kind="ESTIMATOR_KIND_H1"))


def test_a_second_experiment_has_words():
    message = excitation_message(excitation(), rig=RIG, seed=3)
    at_target = iterator_pb2.AtTarget(level=0.5, duration=75.0)
    told = identification_in_words(message, identifier_pb2.Estimator(kind="ESTIMATOR_KIND_H1"), at_target)
    assert ", then at 0.5 of the target's RMS, 75 s; " in told


def test_a_second_experiment_is_part_of_the_specification():
    campaign = load_campaign("front_axle_demo")
    silent = Signals(tuple(Channel(name, "N") for name in NAMES), 1000.0, np.zeros((6, 2000)))
    spec = build_specification(campaign, id="x", rig=RIG, target=silent, source="none")
    assert (spec.at_target.level, spec.at_target.duration) == (0.5, 75.0)
    excitation_only = {**campaign.excitation.model_dump(), "at_target": None}
    without = campaign.model_copy(update={"excitation": ExcitationSettings.model_validate(excitation_only)})
    assert not build_specification(without, id="x", rig=RIG, target=silent, source="none").HasField("at_target")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"kind": ExcitationKind.PURE_RANDOM}, "has at_target for pure_random"),
        ({"at_target": {"duration": 1.5}}, r"fades of 1 s in 1\.5 s of at_target"),
        ({"at_target": {"level": 0.0, "duration": 75.0}}, "greater than 0"),
        ({"at_target": {"level": 1.5, "duration": 75.0}}, "less than or equal to 1"),
        ({"at_target": {}}, "duration"),
    ],
)
def test_a_second_experiment_that_cannot_be_is_refused(changes, sentence):
    given = load_campaign("front_axle_demo").excitation.model_dump(exclude_none=True)
    with pytest.raises(ValidationError, match=sentence):
        ExcitationSettings.model_validate(given | changes)


@pytest.mark.parametrize("kind", list(EstimatorKind))
def test_every_estimator_reaches_the_bus_and_has_words(kind):
    message = estimator_message(EstimatorSettings(kind=kind, block_samples=2048, local_order=3))
    assert identifier_pb2.EstimatorKind.Name(message.kind) == f"ESTIMATOR_KIND_{kind.name}"
    assert message.local_order == 3
    assert "unknown" not in identification_in_words(excitation_message(excitation(), rig=RIG, seed=3), message)


def test_the_contract_offers_nothing_that_a_campaign_cannot_ask_for():
    assert {
        name.removeprefix("EXCITATION_KIND_") for name in identifier_pb2.ExcitationKind.DESCRIPTOR.values_by_name
    } == {
        "UNSPECIFIED",
        *(kind.name for kind in ExcitationKind),
    }
    assert {
        name.removeprefix("ESTIMATOR_KIND_") for name in identifier_pb2.EstimatorKind.DESCRIPTOR.values_by_name
    } == {
        "UNSPECIFIED",
        *(kind.name for kind in EstimatorKind),
    }


def test_drives_may_have_spectra_and_peaks_of_their_own():
    settings = excitation(
        rms=None,
        peak=0.02,
        drive_spectra={
            "left_lateral": {"corner_frequency": 40.0},
            "right_lateral": {"table": [[0.5, 1.0], [40.0, 0.1]]},
        },
    )
    message = excitation_message(settings, rig=RIG, seed=3)
    assert not message.HasField("rms")
    np.testing.assert_array_equal(from_array(message.peak), np.full(6, 0.02))
    assert not message.HasField("spectrum")
    assert [one.WhichOneof("shape") for one in message.drive_spectra] == ["white_pink"] * 4 + ["table", "white_pink"]
    assert message.drive_spectra[0].white_pink.corner_frequency == 4.0
    assert message.drive_spectra[1].white_pink.corner_frequency == 40.0
    np.testing.assert_array_equal(from_array(message.drive_spectra[4].table.density), [1.0, 0.1])


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("excitation.peak", 0.01, "needs an rms or a peak, and not both"),
        ("excitation.rms", None, "needs an rms or a peak, and not both"),
        ("excitation.kind", "loud", "loud"),
        ("excitation.capture_blocks", 0, "capture_blocks"),
        ("excitation.detection_share", 0.6, "detection_share"),
        ("excitation.drive_spectra", {"left_lateral": {}}, "either a corner_frequency or a table"),
        ("estimator.kind", "h3", "h3"),
        ("estimator.local_order", 9, "local_order"),
    ],
)
def test_a_wrong_value_is_refused(path, value, said):
    with pytest.raises(InputError, match=said):
        parsed_of(changed(path, value))


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("excitation.rms", 0.05, "leaves room for 0.0333333 m RMS"),
        ("excitation.drive_spectra", {"middle": {"corner_frequency": 4.0}}, "unknown channel middle"),
    ],
)
def test_what_does_not_fit_the_rig_is_refused_before_anything_is_asked(path, value, said):
    with pytest.raises(InputError, match=said):
        check_against_rig(parsed_of(changed(path, value)), RIG)
    if path == "excitation.rms":
        sweep = changed(path, value).replace("pure_random", "swept_sine")
        check_against_rig(parsed_of(sweep), RIG)


def test_the_shipped_campaigns_tell_noise_and_distortion_apart():
    assert shipped_campaigns()
    for name in shipped_campaigns():
        shipped = load_campaign(name).excitation
        assert (shipped.kind, shipped.capture_blocks) == (ExcitationKind.RANDOM_ORTHOGONAL, 2)


@pytest.mark.parametrize(("fall", "told"), [(0.0, "1 to 40 Hz, flat,"), (3.0, "1 to 40 Hz, flat to 5 Hz, then −3 dB")])
def test_a_spectrum_that_does_not_fall_is_flat(fall, told):
    message = identifier_pb2.Excitation()
    message.spectrum.lowest_frequency, message.spectrum.highest_frequency = 1.0, 40.0
    message.spectrum.corner_frequency, message.spectrum.decibels_per_octave = 5.0, fall
    assert told in identification_in_words(message, identifier_pb2.Estimator())
