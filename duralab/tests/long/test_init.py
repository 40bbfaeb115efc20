"""`duralab init`: a campaign file that runs as it stands."""

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import synthetic_campaign
import yaml
from fake_gateway import Defect, Gateway
from test_cli import COMMAND, finish, invoke

import duralab_bus
from duralab import Channel, Signals, load_campaign, shipped_campaigns
from duralab.campaign import (
    campaign_name,
    campaign_text,
    check_against_rig,
    load_import_settings,
    measured_target,
    parse_campaign,
    template_for,
)
from duralab.campaign.rig_experiment import level_of
from duralab.data import Rig
from duralab.errors import InputError
from duralab.formats import write_signals


@pytest.mark.parametrize("template", shipped_campaigns())
def test_it_is_the_shipped_campaign_under_its_own_name(template, tmp_path):
    file = tmp_path / "My rig.yaml"
    assert invoke("init", file, "--from", template)[0] == 0
    own, shipped = load_campaign(file), load_campaign(template)
    assert own.name == "my-rig"
    assert {**own.model_dump(), "name": shipped.name} == shipped.model_dump()


def test_a_road_that_does_not_ship_is_named_with_its_source_until_it_is_there(tmp_path):
    code, stdout, _ = invoke("init", tmp_path / "mine.yaml", "--from", "belgian_block")
    assert code == 0
    assert "Its road belgian_block.crg is missing in the folder of the campaign file; it is" in stdout
    assert "ASAM OpenCRG" in stdout
    (tmp_path / "belgian_block.crg").touch()
    assert "missing" not in invoke("init", tmp_path / "mine.yaml", "--from", "belgian_block", "--replace")[1]
    assert "missing" not in invoke("init", tmp_path / "other.yaml")[1]


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
    assert content["control_band"]["lowest_frequency"] == 0.5


def test_no_channel_of_a_measured_file_is_guessed(rig, tmp_path):
    given = signals(["left_vertical", "FZ_R"], rate=1000.0)
    content, missing = target_of(given, rig, tmp_path)
    assert missing == [channel.name for channel in rig.responses if channel.name != "left_vertical"]
    assert content["target"]["channels"]["left_vertical"] == "left_vertical"
    assert content["target"]["channels"]["right_vertical"] == "CHANNEL_FOR_RIGHT_VERTICAL"
    assert "edit" not in content["target"]


SETTINGS = """
channels:
  left_vertical: {from: FZ_L, unit: kN, scale: -1}
  right_vertical: right
calculated:
  - {name: right, kind: force, sum: [FZ_R, FZ_X]}
edit:
  - cut: {from: 0.01, to: 0.15}
  - despike
  - taper: {seconds: 0.01}
"""


def test_settings_say_channels_and_steps_of_a_measured_file(rig, tmp_path):
    (tmp_path / "map.yaml").write_text(SETTINGS)
    asked = load_import_settings(tmp_path / "map.yaml")
    others = [channel.name for channel in rig.responses if channel.name not in asked.channels]
    given = signals(["FZ_L", "FZ_R", "FZ_X", *others])
    section, missing = measured_target(given, source=tmp_path / "a.rsp", folder=tmp_path, rig=rig, settings=asked)
    text = campaign_text("front_axle_demo", path=tmp_path / "mine.yaml", target=section)
    target = parse_campaign(text, name="mine.yaml").target
    assert missing == []
    assert {name: target.channels[name] for name in asked.channels} == asked.channels
    assert [target.channels[name].source for name in others] == others
    assert target.calculated == asked.calculated
    assert target.edit[:-1] == asked.edit
    assert target.edit[-1].resample.rate == rig.sample_rate


def test_a_step_that_resamples_to_the_rate_of_the_rig_is_not_repeated(rig, tmp_path):
    (tmp_path / "map.yaml").write_text(f"edit: [{{resample: {{rate: {rig.sample_rate}}}}}]\n")
    asked = load_import_settings(tmp_path / "map.yaml")
    given = signals([channel.name for channel in rig.responses])
    section, _ = measured_target(given, source=tmp_path / "a.rsp", folder=tmp_path, rig=rig, settings=asked)
    assert section.count("resample") == 1


def test_wrong_settings_are_refused_before_the_file_is_written(fake_services, rig, tmp_path):
    source = tmp_path / "road.csv"
    write_signals(signals([channel.name for channel in rig.responses], rate=1000.0), source)
    (tmp_path / "map.yaml").write_text("channels: {left_vertcal: left_vertical}\n")
    init = ("init", tmp_path / "mine.yaml", "--target", source, "--settings", tmp_path / "map.yaml")
    code, _, stderr = invoke(*init)
    assert (code, "target.channels has unknown response left_vertcal" in stderr) == (2, True)
    assert not (tmp_path / "mine.yaml").exists()


def test_with_a_measured_file_the_rig_is_asked_for_its_responses(fake_services, rig, tmp_path):
    source = tmp_path / "road.csv"
    write_signals(signals([channel.name for channel in rig.responses], rate=1000.0), source)
    code, stdout, stderr = invoke("init", tmp_path / "mine.yaml", "--target", source, "--json")
    assert code == 0, stderr
    assert json.loads(stdout)["to_say"] == []
    assert str(load_campaign(tmp_path / "mine.yaml").target.file) == "road.csv"


BEAM = Rig(
    name="beam",
    specimen="a beam\nrig: other\x07 \u2028 seed: 1",
    engine="beam controller",
    version="1.0",
    sample_rate=200.0,
    drives=(
        Channel("front", "m", minimum=-0.05, maximum=0.04, slew_limit=1.0),
        Channel("on", "N", minimum=-2e4, maximum=2e4),
    ),
    responses=tuple(Channel(f"{end}_force", "N", minimum=-5e4, maximum=5e4) for end in ("front", "rear")),
    longest_drive_seconds=3600.0,
    static_response=np.zeros(2),
    content_hash="",
)


@pytest.mark.parametrize("template", shipped_campaigns())
def test_for_a_rig_that_is_not_shipped_the_experiment_follows_from_its_description(template, tmp_path):
    text = campaign_text(template, path=tmp_path / "mine.yaml", rig=BEAM)
    content = yaml.safe_load(text)
    assert (content["rig"], content["seed"], content["target"]) == ("beam", 20140915, {"file": "target.csv"})
    assert "#   front [m] -0.05 to 0.04, at most 1 per second\n" in text
    assert "; 200 Hz, drives up to 3600 s.\n" in text
    excitation = content["excitation"]
    assert excitation["rms"]["on"] == 200.0
    # The tighter of the two limits of the range, and the rate of a signal with this spectrum.
    assert 0.0 < excitation["rms"]["front"] <= 0.01 * 0.04
    assert excitation["highest_frequency"] <= 0.4 * 200.0
    block = content["estimator"]["block_samples"]
    assert block in (256, 512)
    assert excitation["duration"] >= 2 * 2 * 3 * block / 200.0 + excitation["fade"]
    assert content["control_band"]["highest_frequency"] < excitation["highest_frequency"]
    check_against_rig(parse_campaign(text, name="mine.yaml"), rig=BEAM)


def test_the_rate_of_the_experiment_is_well_below_the_rate_limit():
    """The identifier's own multisine of this spectrum and RMS: its largest rate is about half of what is allowed."""
    channel = replace(BEAM.drives[0], minimum=-10.0, maximum=10.0)
    level = level_of(channel, replace(BEAM, sample_rate=1000.0), largest_share=0.01)
    generator, time = np.random.default_rng(5), np.arange(20_000) / 1000.0
    frequency = np.arange(0.4, 45.0, 0.05)
    amplitude = np.minimum(1.0, 1.0 / frequency)
    phase = generator.uniform(0.0, 2.0 * np.pi, frequency.size)
    drive = (amplitude * np.cos(2.0 * np.pi * frequency * time[:, None] + phase)).sum(axis=1)
    rate = np.abs(np.gradient(level * drive / drive.std(), time)).max()
    assert 0.25 <= rate / channel.slew_limit <= 0.6


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"drives": (Channel("speed", "m/s", minimum=0.0, maximum=60.0),)}, "allows its drive 'speed' 0 to 60 m/s"),
        ({"drives": (Channel("speed", "m/s"),)}, "needs finite limits on both sides"),
        ({"longest_drive_seconds": 10.0}, "plays 10 s at most"),
    ],
)
def test_a_rig_for_which_no_experiment_follows_is_refused(tmp_path, changes, said):
    with pytest.raises(InputError, match=said):
        campaign_text("front_axle_demo", path=tmp_path / "mine.yaml", rig=replace(BEAM, **changes))


def test_a_rig_on_the_bus_is_asked_even_where_no_lab_is_complete(tmp_path):
    with duralab_bus.open_bus(service="rig_sim") as bus:
        Gateway(bus, "stranger", Defect.NONE)
        connect = ("--connect", bus.listening[0])
        code, stdout, stderr = invoke("init", tmp_path / "mine.yaml", "--rig", "stranger", *connect, "--json")
        missing = invoke("init", tmp_path / "other.yaml", "--rig", "strangr", *connect)
    assert code == 0, stderr
    told = json.loads(stdout)
    assert told["rig"] == "stranger"
    assert told["run"].endswith(f"--connect {connect[1]}")
    assert told["target_awaited"] == str(tmp_path / "target.csv")
    campaign = load_campaign(tmp_path / "mine.yaml")
    assert set(campaign.excitation.rms) == set(synthetic_campaign.NAMES)
    assert missing[0] == 2
    assert "There is no rig 'strangr'; there are stranger." in missing[2]
    assert not (tmp_path / "other.yaml").exists()


def test_the_campaign_that_is_shipped_for_a_rig_is_taken(fake_services, tmp_path):
    code, _, stderr = invoke("init", tmp_path / "mine.yaml", "--rig", "front_axle")
    assert code == 0, stderr
    own, shipped = load_campaign(tmp_path / "mine.yaml"), load_campaign("front_axle_demo")
    assert {**own.model_dump(), "name": shipped.name} == shipped.model_dump()
    assert "#   left_vertical [m] -0.125 to 0.125, at most 2 per second\n" in own.text
    assert template_for("spindle_coupled") == "spindle_coupled_demo"
