"""Campaign files with the keys of before are read, and one sentence names the new ones."""

import pytest

from duralab_settings import SettingsError, new_key, with_new_keys
from duralab_settings.old_keys import RENAMED

OLD = {
    "name": "demo",
    "at_limits": "refuse",
    "confirm": {"playbacks": 2},
    "update": {"algorithm": "secant", "gain": 0.5, "caution": 2.0, "groups": {"a": {"channels": ["x"], "gain": 0.4}}},
    "stop": {"iterations": 3},
}
NEW = {
    "name": "demo",
    "limit_policy": "refuse",
    "confirmations": 2,
    "update": {
        "kind": "secant",
        "iteration_gain": 0.5,
        "secant": {"caution": 2.0},
        "groups": {"a": {"channels": ["x"], "iteration_gain": 0.4}},
    },
    "stop": {"iterations": 3},
}


def test_old_keys_become_new_ones_and_one_sentence_names_them():
    content, remarks = with_new_keys(OLD, name="my.yaml: ")

    assert content == NEW
    (sentence,) = remarks
    assert sentence.startswith("my.yaml: at_limits is limit_policy now, confirm.playbacks is confirmations now")
    assert "update.groups.a.gain is update.groups.a.iteration_gain now" in sentence
    assert "algorithm" in OLD["update"]


def test_new_keys_stay_as_they_are_without_a_remark():
    assert with_new_keys(NEW) == (NEW, ())


@pytest.mark.parametrize("content", [{}, {"update": None}, {"update": [1]}, {"update": {"groups": 3}}, {1: 2}])
def test_what_is_no_section_is_left_to_the_check_of_the_campaign(content):
    assert with_new_keys(content) == (content, ())


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"update": {"gain": 1.0, "iteration_gain": 0.5}}, "x: update.gain and update.iteration_gain are one setting"),
        ({"update": {"caution": 1.0, "secant": {"caution": 0.5}}}, "leave update.caution out"),
        ({"update": {"caution": 1.0, "secant": 3}}, "leave update.caution out"),
    ],
)
def test_one_setting_under_two_names_is_refused(content, sentence):
    with pytest.raises(SettingsError, match=sentence):
        with_new_keys(content, name="x: ")


def test_dotted_keys_have_the_same_new_names():
    assert [new_key(old) for old in RENAMED if "*" not in old] == [new for new in RENAMED.values() if "*" not in new]
    assert new_key("update.gain.left_vertical") == "update.iteration_gain.left_vertical"
    assert new_key("update.groups.side.gain") == "update.groups.side.iteration_gain"
    assert new_key("update.gain_schedule") == "update.gain_schedule"
