"""`duralab init`: a campaign file that runs as it stands."""

import json
import subprocess

import numpy as np
import pytest
import yaml
from test_cli import COMMAND, finish, invoke

from duralab import Channel, Signals, load_campaign, shipped_campaigns
from duralab.campaign_template import campaign_name, campaign_text, measured_target
from duralab.formats import write_signals
from duralab.rig import Rig


@pytest.mark.parametrize("template", shipped_campaigns())
def test_it_is_the_shipped_campaign_under_its_own_name(template, tmp_path):
    file = tmp_path / "My rig.yaml"
    assert invoke("init", file, "--from", template)[0] == 0
    own, shipped = load_campaign(file), load_campaign(template)
    assert own.name == "my-rig"
    assert {**own.model_dump(), "name": shipped.name} == shipped.model_dump()


def test_every_key_has_a_comment_above_it_or_above_its_section(tmp_path):
    file = tmp_path / "campaign.yaml"
    invoke("init", file)
    lines = file.read_text().splitlines()
    top = [number for number, line in enumerate(lines) if line and not line.startswith((" ", "#"))]
    assert len(top) > 8
    assert all(lines[number - 1].startswith("# ") for number in top)


def test_it_runs_as_it_was_written(fake_services, tmp_path):
    invoke("init", tmp_path / "first.yaml")
    process = subprocess.Popen(
        [*COMMAND, "run", "first.yaml", "--json"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    code, stdout, stderr = finish(process)
    assert code in (0, 3), stderr
    told = json.loads(stdout)
    assert told["campaign"] == "first"
    assert told["playbacks"] == list(range(1, 8))
    assert (tmp_path / told["report"]).exists()


def test_a_file_that_is_there_stays_as_it_is(tmp_path):
    file = tmp_path / "campaign.yaml"
    file.write_text("mine")
    code, _, stderr = invoke("init", file)
    assert code == 2
    assert "give --replace" in stderr
    assert file.read_text() == "mine"
    assert invoke("init", file, "--replace")[0] == 0


def test_an_unknown_template_is_refused(tmp_path):
    code, _, stderr = invoke("init", tmp_path / "a.yaml", "--from", "moon")
    assert code == 2
    assert "shipped campaigns are belgian_block, front_axle_demo, spindle_coupled_demo" in stderr
    assert not (tmp_path / "a.yaml").exists()


def test_the_name_has_the_letters_that_a_name_may_have(tmp_path):
    assert campaign_name(tmp_path / "Über Weg 2.yaml") == "ber-weg-2"
    assert campaign_name(tmp_path / "★.yaml") == "campaign"


@pytest.fixture
def rig():
    import synthetic_campaign

    return Rig.from_message(synthetic_campaign.description())


def signals(names, *, rate=500.0):
    return Signals(tuple(Channel(name, "kN") for name in names), rate, np.ones((len(names), 100)))


def target_of(given, rig, folder):
    section, missing = measured_target(given, source=folder / "a road's.rsp", folder=folder, rig=rig)
    text = campaign_text("front_axle_demo", path=folder / "mine.yaml", target=section)
    return yaml.safe_load(text), missing


def test_a_measured_file_with_the_rigs_names_needs_nothing_said_but_its_rate(rig, tmp_path):
    given = signals([channel.name for channel in rig.responses])
    content, missing = target_of(given, rig, tmp_path)
    assert missing == []
    assert content["target"] == {"file": "a road's.rsp", "edit": [{"resample": {"rate": 1000}}]}
    assert content["control_band"]["lowest_frequency"] == 0.7


def test_no_channel_of_a_measured_file_is_guessed(rig, tmp_path):
    given = signals(["left_vertical", "FZ_R"], rate=1000.0)
    content, missing = target_of(given, rig, tmp_path)
    assert missing == [channel.name for channel in rig.responses if channel.name != "left_vertical"]
    assert content["target"]["channels"]["left_vertical"] == "left_vertical"
    assert content["target"]["channels"]["right_vertical"] == "CHANNEL_FOR_RIGHT_VERTICAL"
    assert "edit" not in content["target"]


def test_with_a_measured_file_the_rig_is_asked_for_its_responses(fake_services, rig, tmp_path):
    source = tmp_path / "road.csv"
    write_signals(signals([channel.name for channel in rig.responses], rate=1000.0), source)
    code, stdout, stderr = invoke("init", tmp_path / "mine.yaml", "--target", source, "--json")
    assert code == 0, stderr
    assert json.loads(stdout)["to_say"] == []
    assert str(load_campaign(tmp_path / "mine.yaml").target.file) == "road.csv"
