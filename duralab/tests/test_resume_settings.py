"""Settings to resume with: whole campaign files, and the keys of two sections that change."""

import pytest
import yaml

import duralab
from duralab.campaign import PartialSettings, completed, load_campaign, load_settings
from duralab.errors import InputError
from duralab_proto.v1 import iterator_pb2

SHIPPED = load_campaign("front_axle_demo")


def written(tmp_path, text):
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    return path


def parent(text=SHIPPED.text):
    return iterator_pb2.CampaignSpec(id="demo", scenario=text)


def test_keys_that_are_not_given_keep_the_values_of_the_parent(tmp_path):
    own = yaml.safe_load(SHIPPED.text)
    own["update"] |= {"iteration_gain": 0.35, "secant": {"caution": 3.0}, "kind": "basic_twr"}
    own["stop"] |= {"iterations": 4, "relative_rms_error": 0.02, "damage_ratio": [0.8, 1.25]}
    settings = load_settings(written(tmp_path, "stop: {iterations: 9, damage_ratio: null}\nupdate: {caution: 0.5}\n"))
    campaign = completed(settings, parent(yaml.safe_dump(own)))
    own["update"]["secant"]["caution"], own["stop"]["iterations"], own["stop"]["damage_ratio"] = 0.5, 9, None
    assert campaign.model_dump() == duralab.Campaign.model_validate(own).model_dump()
    # The file that is recorded gives the same again, and says what was changed.
    (tmp_path / "again.yaml").write_text(campaign.text)
    assert load_campaign(tmp_path / "again.yaml").model_dump() == campaign.model_dump()
    first_line = "# Campaign demo with other settings: stop.iterations, stop.damage_ratio, update.secant.caution."
    assert campaign.text.splitlines()[0] == first_line


def test_a_section_alone_leaves_the_other_as_it_is(tmp_path):
    campaign = completed(load_settings(written(tmp_path, "stop: {iterations: 9}\n")), parent())
    assert campaign.update == SHIPPED.update
    assert campaign.stop == SHIPPED.stop.model_copy(update={"iterations": 9})


def test_a_whole_campaign_file_and_a_shipped_one_still_count(tmp_path):
    for source in (written(tmp_path, SHIPPED.text), "front_axle_demo"):
        assert load_settings(source).model_dump() == SHIPPED.model_dump()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("update: {gane: 0.5}\n", "unknown key 'gane' in update; .*did you mean 'iteration_gain'"),
        ("stop: {iterations: 0}\n", r"stop\.iterations is 0"),
        ("stop: {iterations: two}\n", r"stop\.iterations is 'two'"),
        ("update: {gain_curve: [{frequency: 1.0}]}\n", r"update\.gain_curve\.0\.share is missing"),
        ("update: 5\n", "update is 5"),
        ("update:\n", "update is empty"),
        ("stop: {iterations: 9}\ncontrol_band: {lowest_frequency: 1.0, highest_frequency: 9.0}\n", "has control_band;"),
        ("stop: {iterations: 9}\nstops: {}\n", "has stops; settings to resume with are `update`, `stop` or both"),
        ("{}\n", "is empty; give `update`, `stop` or both"),
        ("", "is empty; a file of settings to resume with holds the keys update, stop"),
        ("- stop\n", "holds a list"),
        ("stop: {iterations: 9}\nstop: {iterations: 8}\n", "is not YAML"),
    ],
)
def test_what_is_no_setting_is_refused_as_it_is_read(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        load_settings(written(tmp_path, text))


def test_a_value_that_does_not_fit_the_values_that_stay_is_refused(tmp_path):
    own = yaml.safe_load(SHIPPED.text) | {"levels": [0.5, 0.75, 1.0]}
    settings = load_settings(written(tmp_path, "stop: {iterations: 2}\n"))
    with pytest.raises(InputError, match=r"settings.yaml, with what campaign 'demo' has: .*levels"):
        completed(settings, parent(yaml.safe_dump(own)))


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        ("", "holds no campaign file; give a whole"),
        ("rig: front_axle\n", r"is not from this version \(.*; give a whole"),
    ],
)
def test_without_a_campaign_file_in_the_recording_a_whole_one_is_asked_for(scenario, message):
    with pytest.raises(InputError, match=message):
        completed(PartialSettings("s.yaml", {"stop": {"iterations": 9}}), parent(scenario))
