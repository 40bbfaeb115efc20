import re
from copy import deepcopy
from pathlib import Path

import pytest
import yaml
from pydantic import BaseModel

import duralab
from duralab.campaign import (
    Campaign,
    is_project,
    load_campaign,
    load_identification,
    load_project,
    parse_campaign,
    shipped_campaigns,
)
from duralab.errors import InputError

CONTENT = {
    "name": "mine",
    "rig": "front_axle",
    "seed": 1,
    "target": {"road": {"iso_class": "C/D", "seed": 2, "duration": 10.0}, "vehicle": "predecessor"},
    "excitation": {
        "kind": "pure_random",
        "lowest_frequency": 0.5,
        "highest_frequency": 40,
        "corner_frequency": 4,
        "decibels_per_octave": 6,
        "rms": 0.002,
        "duration": 30.0,
        "fade": 1.0,
    },
    "estimator": {"block_samples": 2048, "overlap": 0.5},
    "control_band": {"lowest_frequency": 0.7, "highest_frequency": 35.0},
    "update": {"kind": "adaptive_modelling", "iteration_gain": 0.7},
    "stop": {"iterations": 3},
}


def changed(path, value):
    """Return the campaign as YAML with one value changed; None removes the key."""
    content = yaml.safe_load(yaml.safe_dump(CONTENT))
    *sections, key = path.split(".")
    place = content
    for section in sections:
        place = place[section]
    if value is None:
        del place[key]
    else:
        place[key] = value
    return yaml.safe_dump(content)


def sections_of(model):
    yield model
    for field in model.model_fields.values():
        for kind in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield from sections_of(kind)


def test_a_valid_campaign_keeps_its_text_and_folder(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(CONTENT))
    campaign = load_campaign(path)
    assert campaign.text == path.read_text()
    assert campaign.folder == tmp_path
    assert campaign.excitation.highest_frequency == 40.0


def test_a_control_band_from_0_needs_holds_and_may_reach_below_the_excited_band():
    content = deepcopy(CONTENT)
    content["control_band"]["lowest_frequency"], content["excitation"]["static_hold"] = 0, 4.0
    campaign = parse_campaign(yaml.safe_dump(content), name="mine.yaml")
    assert campaign.control_band.lowest_frequency == 0.0 < campaign.excitation.lowest_frequency


@pytest.mark.parametrize("name", shipped_campaigns())
def test_shipped_campaigns_are_valid_and_comment_every_key(name):
    campaign = load_campaign(name)
    assert campaign.name == name
    lines = campaign.text.splitlines()
    for number, line in enumerate(lines):
        is_channel = re.match(r"\s+(left|right)_", line)
        if re.match(r"\s*[a-z_]+:", line) and not is_channel:
            above = lines[number - 1].strip()
            assert above.startswith("#"), line


def test_every_field_says_what_it_is():
    for model in sections_of(Campaign):
        for name, field in model.model_fields.items():
            assert field.description, f"{model.__name__}.{name}"


@pytest.mark.parametrize(
    ("path", "value", "parts"),
    [
        (
            "update.gian",
            0.5,
            ["unknown key 'gian' in update", "allowed: kind, gain_schedule", "did you mean 'iteration_gain'?"],
        ),
        ("update.iteration_gain", 1.5, ["update.iteration_gain is 1.5", "less than or equal to 1"]),
        (
            "update.iteration_gain",
            {"left_vertical": -1},
            ["update.iteration_gain.left_vertical is -1", "greater than 0"],
        ),
        ("update.kind", "magic", ["update.kind is 'magic'", "'basic_twr', 'adaptive_modelling', 'secant'"]),
        ("update.gain_schedule", [0.5, 0.0], ["update.gain_schedule.1 is 0.0", "greater than 0"]),
        (
            "update.gain_curve",
            [{"frequency": 9.0, "share": 0.5}, {"frequency": 2.0, "share": 1.0}],
            ["update has a gain_curve at [9.0, 2.0] Hz", "must rise"],
        ),
        ("stop.damage_ratio", [1.1, 1.2], ["stop has damage_ratio [1.1, 1.2]", "the first must be below 1"]),
        ("stop.damage_exponent", 4, ["stop.damage_exponent is 4", "3, 5 or 8"]),
        ("limit_policy", "clip", ["limit_policy is 'clip'", "'refuse', 'project'"]),
        ("levels", [0.5, 0.75], ["levels is [0.5, 0.75]", "end with 1"]),
        ("levels", [0.5, 0.4, 1.0], ["levels is [0.5, 0.4, 1.0]", "never fall"]),
        ("levels", [0.1] * 9 + [1.0], ["levels has 9 playbacks below 1", "stop.iterations is"]),
        ("accept", {"damage_ratio": [1.1, 2.0]}, ["accept has damage_ratio [1.1, 2.0]", "the first must be below 1"]),
        ("accept", {"damage_exponent": 4}, ["accept.damage_exponent is 4", "allowed: 3, 5, 8"]),
        ("accept", {"energy_outside_band": 5.0}, ["accept.energy_outside_band is 5.0", "less than or equal to 1"]),
        (
            "accept",
            dict.fromkeys(("relative_rms_error", "peak_ratio", "damage_ratio", "energy_outside_band")),
            ["accept has no limit, all are null", "give one limit at least"],
        ),
        ("rig", "Front Axle", ["rig is 'Front Axle'"]),
        ("name", "a/b", ["name is 'a/b'"]),
        ("seed", -1, ["seed is -1", "greater than or equal to 0"]),
        ("seed", "x", ["seed is 'x'"]),
        ("stop", None, ["stop is missing"]),
        ("stop.iterations", 0, ["stop.iterations is 0", "greater than or equal to 1"]),
        ("estimator.overlap", 1.0, ["estimator.overlap is 1.0", "less than 1"]),
        ("estimator.block_samples", 1001, ["estimator.block_samples is 1001", "multiple of 2"]),
        ("excitation.fade", 20.0, ["excitation has fades of 20 s in 30 s"]),
        ("excitation.corner_frequency", 99, ["excitation has", "must rise in this order"]),
        ("control_band.highest_frequency", 60.0, ["control_band reaches from 0.7 to 60 Hz", "0.5 to 40 Hz"]),
        ("control_band.lowest_frequency", 36.0, ["control_band reaches from 36 to 35 Hz"]),
        ("control_band.lowest_frequency", 0.0, ["control_band at 0 Hz", "excitation.static_hold 0", "e.g. 4 s"]),
        ("control_band", {"lowest_frequency": 0, "highest_frequency": 35, "lower_flank": 0.1}, ["lower_flank 0.1 Hz"]),
        ("excitation.static_hold", -1.0, ["excitation.static_hold"]),
        ("target.road.iso_class", "Q", ["target.road.iso_class is 'Q'", "A (very good) to E"]),
        ("target.vehicle", None, ["target has a road but no vehicle"]),
        ("target.file", "x.csv", ["target has road and file", "exactly one"]),
        ("target.road", None, ["target has none of road, opencrg and file"]),
        ("target.speed", float("nan"), ["target.speed is nan"]),
        ("target.channels", {"left_vertical": "FZ"}, ["target has channels but no file"]),
        ("target.edit", [{"crop": {}}], ["unknown key 'crop' in target.edit.0", "allowed: cut, remove_mean"]),
        (
            "target.edit",
            [{"cut": {"form": 1}}],
            ["unknown key 'form' in target.edit.0.cut", "allowed: from, to", "did you mean 'from'?"],
        ),
        ("target.edit", [{"cut": {"from": 9, "to": 3}}], ["target.edit.0.cut goes from 9 to 3 s"]),
        ("target.edit", ["remove_mean", {"cut": {"from": -1}}], ["target.edit.1.cut.from is -1", "(Start of the part"]),
        ("target.edit", [{"cut": {}, "taper": {"seconds": 1}}], ["target.edit.0 has cut and taper"]),
        ("target.edit", [{"filter": {}}], ["target.edit.0.filter has none of low_pass"]),
        ("target.edit", [{"filter": {"band_stop": [52, 48]}}], ["has band_stop [52, 48]", "first must be below"]),
        ("target.edit", [{"shorten_by_damage": {"keep": 1.5}}], ["target.edit.0.shorten_by_damage.keep is 1.5"]),
        ("target.edit", ["resample"], ["target.edit.0.resample.rate is missing"]),
        ("target.edit", [{"taper": {"seconds": 1, "to": "one"}}], ["edit.0.taper.to is 'one'", "'mean', 'zero'"]),
    ],
)
def test_wrong_value_is_named_with_its_path_and_what_is_allowed(path, value, parts):
    with pytest.raises(InputError) as caught:
        parse_campaign(changed(path, value), name="mine.yaml")
    for part in ["mine.yaml", *parts]:
        assert part in caught.value.message
    assert "\n" not in caught.value.message


def test_a_wrong_key_of_a_channel_is_named_with_what_is_allowed():
    target = {"file": "road.rsp", "channels": {"left_vertical": {"from": "FZ", "sclae": -1}}}
    with pytest.raises(InputError) as caught:
        parse_campaign(changed("target", target), name="x")
    assert "unknown key 'sclae' in target.channels.left_vertical; allowed: from, unit, scale" in caught.value.message


def test_a_target_keeps_the_file_s_words_when_it_is_written_again():
    target = {
        "file": "road.rsp",
        "channels": {"left_vertical": {"from": "FZ_FL", "unit": "kN", "scale": -1.0}, "left_lateral": "FY_FL"},
        "edit": [{"cut": {"from": 10.0, "to": 60.0}}, "remove_mean", {"filter": {"low_pass": 60.0}}],
    }
    read = parse_campaign(changed("target", target), name="x")
    again = parse_campaign(read.model_copy().read_from(folder=read.folder, text="").text, name="x")
    assert again.model_dump() == read.model_dump()
    assert again.target.edit[0].settings.start == 10.0
    assert again.target.channels["left_lateral"].source == "FY_FL"


def test_misspelt_key_is_not_reported_as_missing_too():
    content = yaml.safe_load(changed("update.gian", 0.5))
    del content["update"]["iteration_gain"]
    with pytest.raises(InputError) as caught:
        parse_campaign(yaml.safe_dump(content), name="x")
    assert "missing" not in caught.value.message


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "is empty"),
        ("- 1", "holds a list"),
        ("a: [1", "is not YAML: did not find"),
        ("name: a\nname: b", "the key 'name' is given twice (line 2, column 1)"),
        ("seed: 2024-02-30", "'2024-02-30' cannot be read as timestamp"),
        ("a: " + "[" * 3_000, "lists and mappings stand 101 deep"),
        ("a: !!python/object/apply:os.system [ls]", "is not YAML"),
    ],
)
def test_what_is_no_campaign_is_refused(text, part):
    with pytest.raises(InputError, match=re.escape(part)):
        parse_campaign(text, name="x.yaml")


def test_missing_file_names_the_shipped_ones():
    with pytest.raises(InputError, match="front_axle_demo"):
        load_campaign("nowhere.yaml")


def test_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        load_campaign(path)


def test_what_is_left_out_of_accept_has_limits_and_what_is_null_has_none():
    accept = parse_campaign(changed("accept", {"peak_ratio": None, "relative_rms_error": 0.1}), name="x").accept
    assert (accept.relative_rms_error, accept.peak_ratio) == (0.1, None)
    assert (accept.damage_ratio, accept.energy_outside_band) == ((0.8, 1.25), 0.1)
    assert parse_campaign(yaml.safe_dump(CONTENT), name="x").accept.relative_rms_error == 0.15


def test_campaign_made_in_a_script_writes_itself_as_yaml():
    campaign = Campaign.model_validate({**CONTENT, "accept": {"damage_ratio": None}})
    assert parse_campaign(campaign.text, name="x").model_dump() == campaign.model_dump()


def test_public_names_are_all_there():
    for name in duralab.__all__:
        assert getattr(duralab, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        _ = duralab.nothing
    assert Path(duralab.__file__).name == "__init__.py"


def test_a_file_with_older_keys_is_the_same_campaign_and_a_remark_names_the_new_ones():
    content = deepcopy(CONTENT)
    content["update"] = {"algorithm": "adaptive_modelling", "gain": 0.7, "caution": 2.0}
    content |= {"at_limits": "refuse", "confirm": {"playbacks": 2}}
    old = parse_campaign(yaml.safe_dump(content), name="old.yaml")

    content["update"] = {"kind": "adaptive_modelling", "iteration_gain": 0.7, "secant": {"caution": 2.0}}
    new = {key: value for key, value in content.items() if key not in ("at_limits", "confirm")}
    new |= {"limit_policy": "refuse", "confirmations": 2}
    today = parse_campaign(yaml.safe_dump(new), name="new.yaml")

    assert old.model_dump() == today.model_dump() == duralab.Campaign.model_validate(content).model_dump()
    assert today.remarks == ()
    (remark,) = old.remarks
    assert "update.gain is update.iteration_gain now" in remark


def test_a_key_under_its_older_and_its_new_name_is_refused():
    content = deepcopy(CONTENT)
    content["update"] |= {"gain": 0.5}
    with pytest.raises(InputError, match=r"^x: update.gain and update.iteration_gain are one setting"):
        parse_campaign(yaml.safe_dump(content), name="x")


def test_a_folder_with_the_name_of_a_shipped_campaign_does_not_hide_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("front_axle_demo", "front_axle_events"):
        Path(name).mkdir()
    assert load_campaign("front_axle_demo").name == "front_axle_demo"
    assert load_identification("front_axle_demo").excitation == load_campaign("front_axle_demo").excitation
    assert is_project("front_axle_events")
    assert load_project("front_axle_events").name == "front_axle_events"
