"""What a campaign file says it starts from, and what becomes of it in the specification."""

from pathlib import Path

import asammdf
import numpy as np
import pytest
import yaml

from duralab.campaign import load_campaign, parse_campaign
from duralab.data import Channel, Rig, Signals
from duralab.errors import InputError
from duralab.lab.known_before import fill_known, put_first_drive, section_campaign
from duralab.lab.recordings_folder import RecordingsPlace
from duralab_proto.v1 import iterator_pb2

DEMO = yaml.safe_load(load_campaign("front_axle_demo").text)


def campaign(**start_from):
    return parse_campaign(yaml.safe_dump(DEMO | {"start_from": start_from}), name="own.yaml")


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"model_age": 3.0}, r"model_age 3 and no model"),
        ({"model": ""}, r"model"),
        ({"model": "a", "model_age": 0.0}, r"model_age"),
        ({"section": {"from": 5.0, "to": 5.0, "iterations": 2}}, r"from must be below to"),
        ({"section": {"to": 5.0, "iterations": 0}}, r"iterations"),
        ({"section": {"to": 5.0, "iterations": 2}, "drive": "a"}, r"leave the drive out"),
        ({"drives": "a"}, r"drives"),
    ],
)
def test_a_start_that_cannot_be_is_refused(given, sentence):
    with pytest.raises(InputError, match=sentence):
        campaign(**given)


def test_a_section_is_a_campaign_of_its_own_with_the_cut_target():
    plan = campaign(section={"from": 2.0, "to": 8.0, "iterations": 3}, learn_from=["before"])
    section = section_campaign(plan)
    assert section.name == "front_axle_demo-section"
    assert section.stop.iterations == 3
    assert [step.name for step in section.target.edit] == ["cut", "taper"]
    assert (section.target.edit[0].cut.start, section.target.edit[0].cut.end) == (2.0, 8.0)
    assert section.start_from.section is None
    assert section.start_from.learn_from == ("before",)
    # It can be read back as a file of its own.
    assert parse_campaign(section.text, name="section").target == section.target
    assert section_campaign(campaign(learn_from=["before"])) is None


def specification_of(samples):
    channel = Channel("left", "N", 0, -np.inf, np.inf)
    target = Signals((channel,), 100.0, np.zeros((1, samples)))
    return iterator_pb2.CampaignSpec(target=target.to_message())


def test_a_first_drive_stands_at_its_place_between_zeros():
    channel = Channel("left", "m", 0, -1.0, 1.0)
    drive = Signals((channel,), 100.0, np.ones((1, 200)))
    specification = specification_of(500)
    put_first_drive(specification, drive, None, source="before", first_second=1.0)
    padded = Signals.from_message(specification.known.first_drive.drive, field="drive").samples
    np.testing.assert_array_equal(padded, [[0.0] * 100 + [1.0] * 200 + [0.0] * 200])
    assert not specification.known.first_drive.HasField("response")
    with pytest.raises(InputError, match=r"lasts 2 s; the target lasts 1\.5 s: cut the drive"):
        put_first_drive(specification_of(150), drive, None, source="before")


def test_what_is_not_read_of_a_first_drive_is_named(tmp_path):
    time = np.arange(200) / 100
    with asammdf.MDF(version="4.10") as measurement:
        rows = (("left", np.ones(200), "m"), ("gear", np.full(200, b"D"), ""))
        signals = [asammdf.Signal(row, time, name=name, unit=unit, encoding="utf-8") for name, row, unit in rows]
        measurement.append(signals)
        measurement.save(tmp_path / "first.mf4")
    left = Channel("left", "m", 0, -1.0, 1.0)
    rig = Rig("rig", "", "", "", 100.0, (left,), (), 60.0, np.zeros(0), "")
    specification = specification_of(200)
    start = campaign(drive="first.mf4").start_from
    note = fill_known(specification, start, ask=None, rig=rig, place=RecordingsPlace(), folder=tmp_path)
    assert note == "Channels that are not real numbers are left out: gear."
    assert specification.known.first_drive.drive.samples.shape[1] == 200


def test_the_paths_of_a_start_are_texts_of_the_file():
    assert Path(campaign(model="old/recording.mcap").start_from.model).name == "recording.mcap"
