"""Campaigns that start from what is known, in a real lab: a stored model, another event's drive, a section first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from one_experiment import identified_by_one_experiment

import duralab
from duralab.campaign import load_campaign, parse_campaign
from duralab_proto.v1 import identifier_pb2

RIGS = ("front_axle", "predecessor", "front_axle_compliant")


def campaign(name: str, *, iso_class: str = "C/D", rig: str = "front_axle", **changes: object) -> duralab.Campaign:
    content = yaml.safe_load(load_campaign("front_axle_demo").text)
    road = {"iso_class": iso_class, "seed": 12, "duration": 10.0}
    content |= {"name": name, "rig": rig, "target": {"road": road, "vehicle": "predecessor", "speed": 15.0}}
    content["stop"] |= {"relative_rms_error": 0.1, "iterations": 6}
    # Larger first gains than those of the demo, so that a campaign without knowledge is not slow because of them, and
    # one loud experiment: after a second one at its own target a campaign knows as much as it would learn here.
    content["update"]["gain_schedule"] = [0.8, 1.0]
    identified_by_one_experiment(content)
    return parse_campaign(yaml.safe_dump(content | changes), name=name)


def worst(result: duralab.CampaignResult) -> list[float]:
    return [max(channel.relative_rms_error for channel in step.channels) for step in result.status.iterations]


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory):
    with duralab.start(rigs=RIGS, out=tmp_path_factory.mktemp("out")) as lab:
        yield lab


@pytest.fixture(scope="module")
def worn(lab: duralab.Lab) -> duralab.CampaignResult:
    return lab.run(campaign("worn"))


def test_with_model_drive_and_playbacks_of_a_like_road_fewer_playbacks_are_needed(
    lab: duralab.Lab, worn: duralab.CampaignResult
) -> None:
    alone = lab.run(campaign("alone", iso_class="C"))
    known = {"model": str(worn.recording_path.resolve()), "model_age": 1.0, "learn_from": ["worn"], "drive": "worn"}
    result = lab.run(campaign("known", iso_class="C", start_from=known))
    assert len(worst(result)) <= len(worst(alone)) - 2
    assert worst(result)[0] < 0.5 * worst(alone)[0]
    (model,) = result.recording.messages(identifier_pb2.Model)
    assert model.id == worn.recording.model.id
    # The report of a recording whose rig was identified in another one.
    assert result.report().is_file()


def test_a_section_is_iterated_first_and_the_whole_starts_from_it(lab: duralab.Lab) -> None:
    section = {"section": {"from": 2.0, "to": 7.0, "iterations": 3}}
    result = lab.run(campaign("whole", start_from=section))
    of_section = duralab.open_recording(result.recording_path.parent / "section" / "recording.mcap")
    assert of_section.specification.id == "whole-section"
    assert of_section.target.samples.shape[1] == 5000
    first = duralab.Signals.from_message(result.specification.known.first_drive.drive, field="drive").samples
    assert not first[:, :2000].any()
    assert not first[:, 7000:].any()
    assert np.array_equal(first[:, 2000:7000], of_section.playback(of_section.status.best_iteration).drive.samples)
    alone = lab.run(campaign("without_section"))
    assert worst(result)[0] < 0.85 * worst(alone)[0]


def test_what_is_of_another_rig_or_not_there_is_refused(lab: duralab.Lab, worn: duralab.CampaignResult) -> None:
    model = str(worn.recording_path.resolve())
    for start, sentence in (
        ({"model": "worn"}, r"only a model of this very rig and specimen counts"),
        ({"learn_from": ["worn"]}, r"playbacks of another rig or specimen teach nothing"),
        ({"model": "nobody"}, r"no recording|no file"),
        ({"drive": str(Path(model).with_name("none.mcap"))}, r"There is no recording"),
    ):
        with pytest.raises(duralab.LabError, match=sentence):
            lab.run(campaign("refused", rig="front_axle_compliant", start_from=start))
    narrow = yaml.safe_load(campaign("narrow", start_from={"model": model}).text)
    narrow["control_band"]["highest_frequency"], narrow["excitation"]["highest_frequency"] = 60.0, 80.0
    with pytest.raises(duralab.LabError, match=r"46 Hz|45\.9"):
        lab.run(parse_campaign(yaml.safe_dump(narrow), name="narrow"))
