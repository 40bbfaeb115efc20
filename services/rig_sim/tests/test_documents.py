"""A YAML that is a variant of another: lists and mappings grow, single values change, nonsense is refused."""

import json
import shutil
from pathlib import Path

import pytest
import yaml

from rig_sim import load_rig, shipped_specimens
from rig_sim.loading import shipped_documents
from rig_sim.specimen.specimen import SpecimenError, document_files, load_specimen, read_document


def written(folder, name, content):
    path = folder / name
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return path


def test_a_variant_adds_to_lists_and_mappings_and_changes_values(tmp_path):
    written(tmp_path, "base.yaml", {"a": 1, "list": [1], "map": {"x": 1, "deep": {"y": 2}}})
    changes = {"variant_of": "base.yaml", "a": 2, "list": [3], "map": {"z": 4, "deep": {"y": 5}}, "new": [6]}
    path = written(tmp_path, "mine.yaml", changes)
    assert read_document(path) == {"a": 2, "list": [1, 3], "map": {"x": 1, "z": 4, "deep": {"y": 5}}, "new": [6]}
    assert document_files(path) == (path, tmp_path / "base.yaml")
    further = written(tmp_path, "further.yaml", {"variant_of": "mine.yaml", "list": [4], "map": {"x": 9}})
    assert read_document(further)["list"] == [1, 3, 4]
    assert read_document(further)["map"] == {"x": 9, "z": 4, "deep": {"y": 5}}
    assert document_files(further) == (further, path, tmp_path / "base.yaml")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"variant_of": "../base.yaml"}, "variant_of is '../base.yaml'; it must name a YAML beside it"),
        ({"variant_of": 3}, "variant_of is 3"),
        ({"variant_of": "none.yaml"}, "none.yaml cannot be read: No such file or directory"),
        ({"variant_of": "mine.yaml"}, "mine.yaml is a variant of itself"),
        ({"variant_of": "base.yaml", "list": 3}, "list is a list in what it varies; give a list of what to add"),
        ({"variant_of": "base.yaml", "map": {"deep": []}}, "map.deep is a mapping in what it varies"),
    ],
)
def test_a_variant_of_nonsense_is_refused(tmp_path, content, said):
    written(tmp_path, "base.yaml", {"a": 1, "list": [1], "map": {"deep": {"y": 2}}})
    with pytest.raises(SpecimenError) as caught:
        read_document(written(tmp_path, "mine.yaml", content))
    assert said in str(caught.value)
    assert str(caught.value).endswith(".")


def test_what_only_follows_from_a_wrong_entry_is_not_said(tmp_path):
    document = read_document(shipped_specimens()["front_axle"])
    document["drives"] = [{**document["drives"][0], "unit": "mm"}]
    with pytest.raises(SpecimenError) as caught:
        load_specimen(written(tmp_path, "mine.yaml", document))
    assert "unit is 'mm'" in str(caught.value)
    assert "at least 1 item" not in str(caught.value)


def test_a_rigs_hash_follows_what_it_is_a_variant_of(tmp_path):
    shipped = shipped_specimens()
    for name in ("front_axle_compliant.yaml", "front_axle.sdf", "front_axle_sensors.yaml"):
        shutil.copy(shipped["front_axle_sensors"].with_name(name), tmp_path)
    before = load_rig(tmp_path / "front_axle_sensors.yaml").content_hash
    base = tmp_path / "front_axle_compliant.yaml"
    base.write_text(base.read_text().replace("preload: 5800.0", "preload: 5801.0"))
    assert load_rig(tmp_path / "front_axle_sensors.yaml").content_hash != before


def test_front_axle_sensors_is_the_compliant_axle_with_more_responses():
    names = ("front_axle_compliant", "front_axle_sensors")
    whole, more = (load_specimen(shipped_specimens()[name]) for name in names)
    assert more.responses[: len(whole.responses)] == whole.responses
    same = {"name": whole.name, "title": whole.title, "responses": whole.responses, "watchdogs": whole.watchdogs}
    assert more.watchdogs.responses.items() > whole.watchdogs.responses.items()
    assert more.watchdogs.following_errors == whole.watchdogs.following_errors
    assert more.model_copy(update=same) == whole


@pytest.mark.parametrize("name", ["front_axle", "macpherson"])
def test_a_stiff_rig_differs_from_its_compliant_twin_by_the_horizontal_actuators_alone(name):
    stiff, compliant = (load_specimen(shipped_specimens()[rig]) for rig in (name, f"{name}_compliant"))
    differing = {kind for kind, values in stiff.actuator_kinds.items() if values != compliant.actuator_kinds[kind]}
    assert differing == {"lateral", "longitudinal"}
    # Every actuator is to follow its drive, so all are watched.
    assert set(stiff.watchdogs.following_errors) == {channel.name for channel in stiff.drives}
    same = {"name": name, "title": stiff.title, "actuator_kinds": stiff.actuator_kinds, "watchdogs": stiff.watchdogs}
    assert compliant.model_copy(update=same) == stiff


@pytest.mark.parametrize("content", ["a: 1\nb: 2\na: 3\n", "map: {x: 1, x: 2}\n", "list:\n  - {x: 1, x: 1}\n"])
def test_a_key_that_is_given_twice_is_refused_with_its_line(tmp_path, content):
    with pytest.raises(
        SpecimenError, match=r"mine\.yaml is not YAML: the key '[ax]' is given twice \(line \d"
    ) as caught:
        read_document(written(tmp_path, "mine.yaml", content))
    assert "\n" not in str(caught.value)


def test_the_shipped_documents_are_whole_and_say_where_they_are():
    documents = shipped_documents()
    assert set(documents) == set(shipped_specimens())
    for name, shipped in documents.items():
        path = Path(shipped["path"])
        assert path == shipped_specimens()[name]
        assert "variant_of" not in shipped["document"]
        # JSON is how they are asked for from outside.
        assert json.loads(json.dumps(shipped["document"])) == shipped["document"]
