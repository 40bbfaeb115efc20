"""From a sweep file to its points: keys that are checked, identities that hold."""

from __future__ import annotations

import pytest
import yaml

from duralab.errors import InputError
from duralab.sweeps import load_sweep
from duralab.sweeps.points import PointMaker, grid, grid_size
from duralab.sweeps.specimens import Specimens, change, look_up
from duralab_settings import dump_yaml, parse_yaml

SPECIMEN = """
name: beam
masses:
  - {name: tip, value: 2.0}
  - {name: root, value: 4.0}
"""


@pytest.fixture
def sweep(tmp_path):
    def load(**sections):
        document = {"name": "mine", "campaign": "front_axle_demo", **sections}
        path = tmp_path / "mine.yaml"
        path.write_text(dump_yaml(document))
        return load_sweep(path)

    return load


def points(plan):
    maker = PointMaker(plan)
    return [maker.make(settings) for settings in grid(plan)]


def test_axes_are_crossed_with_each_other_and_with_the_listed_points(sweep):
    plan = sweep(
        points=[
            {"update.kind": "secant", "update.accept_segments": True},
            {"update.kind": "basic_twr", "update.accept_segments": False},
        ],
        axes={"update.iteration_gain": [0.5, 1.0], "seed": {"from": 3, "count": 2}},
    )
    made = points(plan)
    assert grid_size(plan) == len(made) == len({point.id for point in made}) == 8
    document = yaml.safe_load(made[-1].campaign)
    assert document["update"]["kind"] == "basic_twr"
    assert document["seed"] == 4
    assert document["name"] == f"mine-{made[-1].id}"


def test_a_scaled_axis_multiplies_what_stands_in_the_file(sweep):
    made = points(sweep(axes={"excitation.rms.left_vertical": {"scale": [0.5, 2.0]}}))
    assert [point.settings["excitation.rms.left_vertical"] for point in made] == [0.0005, 0.002]


def test_the_identity_is_of_the_content_and_not_of_how_it_is_written(sweep, tmp_path):
    straight = points(sweep(axes={"update.iteration_gain": [0.5]}))[0]
    assert points(sweep(settings={"update.iteration_gain": 0.5}, axes={"seed": [20140915]}))[0].id == straight.id
    # What differs: a setting, the content of a file that is read, a version.
    assert points(sweep(axes={"update.iteration_gain": [0.6]}))[0].id != straight.id
    target = {"target": {"file": "loads.csv"}}
    (tmp_path / "loads.csv").write_text("one")
    campaign = {**yaml.safe_load(straight.campaign), **target, "name": "own"}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(campaign))
    one = points(sweep(campaign="own.yaml", axes={"seed": [1]}))[0]
    assert yaml.safe_load(one.campaign)["target"]["file"] == str((tmp_path / "loads.csv").resolve())
    (tmp_path / "loads.csv").write_text("two")
    assert points(sweep(campaign="own.yaml", axes={"seed": [1]}))[0].id != one.id


def test_other_versions_make_other_points(sweep, monkeypatch):
    plan = sweep(axes={"seed": [1]})
    now = points(plan)[0].id
    monkeypatch.setattr("duralab.sweeps.points.installed_versions", lambda: {"numpy": "0.1"})
    assert points(plan)[0].id != now


@pytest.mark.parametrize(
    ("sections", "told"),
    [
        ({"axes": {"update.gian": [0.5]}}, "did you mean 'iteration_gain'"),
        ({"axes": {"update.iteration_gain": [1.5]}}, "update.iteration_gain: 1.5"),
        ({"axes": {"seed.of": [1]}}, "does not exist in the campaign"),
        ({"axes": {"update..gain": [1]}}, "empty part"),
        ({"axes": {"hold": ["first"]}}, "hold is first, and a sweep has no person who decides"),
        ({"axes": {"rig": {"scale": [1.0]}}}, "only a number can be scaled"),
        ({"campaign": "nowhere.yaml", "axes": {"seed": [1]}}, "no campaign file"),
    ],
)
def test_a_wrong_key_or_value_is_found_before_anything_is_run(sweep, sections, told):
    with pytest.raises(InputError) as caught:
        points(sweep(**sections))
    assert told in caught.value.message


@pytest.mark.parametrize(
    ("sections", "told"),
    [
        ({}, "no axes, no points and no search"),
        ({"axes": {"name": ["a"]}}, "changes name"),
        ({"axes": {"seed": [1]}, "points": [{"seed": 2}]}, "in two of axes"),
        ({"points": [{"seed": 2}, {"rig": "macpherson"}]}, "different keys"),
        ({"axes": {"seed": {"from": 1}}}, "count is missing"),
        ({"axis": {"seed": [1]}}, "unknown key 'axis'; allowed: name, campaign, "),
        (
            {"search": {"settings": {"update.iteration_gain": {"from": 1.0, "to": 0.5}}, "budget": 3, "seed": 1}},
            "below the second",
        ),
    ],
)
def test_a_wrong_sweep_file_is_one_sentence(sweep, sections, told):
    with pytest.raises(InputError) as caught:
        sweep(**sections)
    assert told in caught.value.message


def test_an_axis_that_is_given_twice_is_refused(tmp_path):
    path = tmp_path / "twice.yaml"
    path.write_text(
        "campaign: front_axle_demo\naxes:\n  update.iteration_gain: [0.5]\n  update.iteration_gain: [0.7]\n"
    )
    with pytest.raises(InputError, match=r"the key 'update\.iteration_gain' is given twice \(line 4, column 3\)"):
        load_sweep(path)


def test_too_many_points_are_refused(sweep):
    plan = sweep(axes={"seed": {"from": 1, "count": 1000}, "target.speed": [float(i) for i in range(1, 102)]})
    with pytest.raises(InputError, match="101000 points"):
        grid_size(plan)


def test_a_text_like_a_number_of_yaml_1_2_stays_a_text_in_a_point(sweep, tmp_path):
    (tmp_path / "beam.yaml").write_text(f'{SPECIMEN}description: "1e3"\n')
    specimens = Specimens(sweep(specimens={"beam": "beam.yaml"}, axes={"seed": [1]}))
    _, (text,) = specimens.of(["beam"], {})
    assert parse_yaml(text.text) == specimens.document("beam")
    assert parse_yaml(text.text)["description"] == "1e3"
    (point,) = points(sweep(axes={"target.edit": [[{"remove_mean": {"channels": ["1e3"]}}]]}))
    assert parse_yaml(point.campaign)["target"]["edit"] == [{"remove_mean": {"channels": ["1e3"]}}]


def test_specimens_are_changed_by_name_and_told_apart(sweep, tmp_path):
    (tmp_path / "beam.yaml").write_text(SPECIMEN)
    specimens = Specimens(sweep(specimens={"beam": "beam.yaml"}, axes={"seed": [1]}))
    shipped, (text,) = specimens.of(["front_axle", "beam"], {"beam": {"masses.tip.value": 3.0}})
    assert shipped == ("front_axle",)
    assert yaml.safe_load(text.text)["masses"] == [{"name": "tip", "value": 3.0}, {"name": "root", "value": 4.0}]
    assert specimens.of(["beam"], {})[1][0].content != text.content
    with pytest.raises(InputError, match="does not exist in specimen beam"):
        specimens.of(["beam"], {"beam": {"masses.middle.value": 3.0}})
    with pytest.raises(InputError, match="rigs are front_axle"):
        specimens.of(["front_axle"], {"beam": {"masses.tip.value": 3.0}})


def test_a_dotted_key_finds_sections_and_entries_of_lists():
    document = {"a": {"b": 1}, "list": [{"name": "x", "value": 2}, {"value": 3}]}
    change(document, "a.c.d", 5, what="it")
    change(document, "list.x.value", 6, what="it")
    assert look_up(document, "a.c.d", what="it") == 5
    assert look_up(document, "list.0.value", what="it") == 6
    assert look_up(document, "list.1.value", what="it") == 3
    with pytest.raises(InputError, match="there is b, c"):
        look_up(document, "a.e", what="it")
