"""What may stand in a specimen: the shipped ones are whole, bad ones are refused in one sentence."""

import copy
import shutil

import numpy as np
import pytest
import yaml
from axles import DOUBLE_WISHBONES
from double_wishbone import write_sdf

from duralab_proto.keys import check_rig
from rig_sim.loading import rig_name
from rig_sim.model.assembly import assemble
from rig_sim.playing.player import load_rig
from rig_sim.specimen.specimen import SpecimenError, load_specimen, read_document, shipped_specimens


@pytest.mark.parametrize("axle", DOUBLE_WISHBONES, ids=lambda axle: axle.name)
def test_the_shipped_sdf_is_what_the_hard_points_give(axle):
    path = shipped_specimens()[axle.name].with_suffix(".sdf")
    assert path.read_text() == write_sdf(axle)


def test_bodies_are_physical_and_mirror_images_of_each_other(rig):
    bodies = {body.name: body for body in rig.model.assembly.tree.bodies}
    mirror = np.diag([1.0, -1.0, 1.0])
    for name, body in bodies.items():
        if name == "world":
            continue
        assert body.mass > 0.0
        about_centre = body.inertia - body.mass * (
            body.centre @ body.centre * np.eye(3) - np.outer(body.centre, body.centre)
        )
        moments = np.linalg.eigvalsh(about_centre)
        assert moments[0] > 0.0
        assert moments[0] + moments[1] >= moments[2] * (1 - 1e-9)
        if name.startswith("left_"):
            other = bodies[name.replace("left_", "right_")]
            assert other.mass == body.mass
            # Numbers in the SDF have nine digits.
            np.testing.assert_allclose(other.centre, mirror @ body.centre, atol=1e-8)
            np.testing.assert_allclose(other.inertia, mirror @ body.inertia @ mirror, rtol=1e-7, atol=1e-8)


def test_actuators_load_the_wheel_through_its_centre(front_axle):
    tree = front_axle.model.assembly.tree
    rods = [spring for spring in tree.springs if tree.bodies[spring.body_b].name.endswith("_wheel")]
    assert len(rods) == 6
    for rod in rods:
        piston = tree.joints[[joint.child for joint in tree.joints].index(rod.body_a)]
        # The rod leaves the wheel radially, along its piston's axis.
        np.testing.assert_allclose(np.cross(rod.point_b, piston.axis), 0.0, atol=1e-12)


def document(name="front_axle"):
    return read_document(shipped_specimens()[name])


def written(folder, content, name="front_axle"):
    shutil.copy(shipped_specimens()[name].with_suffix(".sdf"), folder)
    path = folder / "mine.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False))
    return path


def changed(path, value, name="front_axle"):
    content = copy.deepcopy(document(name))
    target = content
    for key in path[:-1]:
        target = target[key]
    if value is None:
        del target[path[-1]]
    else:
        target[path[-1]] = value
    return content


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (["colour"], "red", ["unknown key 'colour'; allowed: "]),
        (["struts", 0, "law", "colour"], 1.0, ["unknown key 'colour' in struts.0.law; allowed: "]),
        (["sdf"], None, ["sdf is missing"]),
        (["sdf"], "../front_axle.sdf", ["sdf is '../front_axle.sdf'"]),
        (["drives"], [], ["drives is []"]),
        (["substeps"], 0, ["substeps is 0", "greater than or equal to 1"]),
        (["sample_rate"], -1000.0, ["sample_rate is -1000.0", "greater than 0"]),
        (
            ["actuator_kinds", "vertical", "cylinder", "area"],
            -1e-3,
            ["actuator_kinds.vertical.cylinder.area is -0.001"],
        ),
        (["struts", 0, "law", "stiffness"], float("nan"), ["struts.0.law.stiffness is nan"]),
        (["responses", 2, "noise_rms"], -1.0, ["responses.2.noise_rms is -1.0"]),
        (["supply", "supply_pressure"], 1.0e5, ["supply", "it must be above return_pressure"]),
        (["struts", 0, "name"], "strut", ["'strut' is mirrored, so its name must begin with 'left_'"]),
        (["struts", 0, "body_b"], "left_lower_arm", ["must join two points of two bodies"]),
        (["rubber", 0, "axis"], [0, 0, 0], ["the axis of 'left_lower_front_x' is [0.0, 0.0, 0.0]"]),
        (["drives", 0, "minimum"], 0.01, ["'left_vertical' goes from 0.01 to 0.115; it must hold 0"]),
        (["drives", 0, "quantity"], "ratio", ["'left_vertical' is a ratio, whose unit is not 'm'"]),
        (["responses", 0, "axis"], "w", ["responses.0.axis is 'w'"]),
        (["name"], "Front Axle", ["name is 'Front Axle'"]),
        (["name"], "a" * 121, ["name is 'aaaa", "at most 120 characters"]),
    ],
)
def test_a_bad_value_in_the_yaml_is_named(tmp_path, path, value, said):
    with pytest.raises(SpecimenError) as caught:
        load_specimen(written(tmp_path, changed(path, value)))
    message = str(caught.value)
    assert message.startswith("specimen mine.yaml: ")
    assert message.endswith(".")
    assert "\n" not in message
    for part in said:
        assert part in message


@pytest.mark.parametrize("content", ["name: " + "a" * 121, "{"])
def test_a_rig_whose_name_and_file_are_too_long_for_a_key_can_be_asked_all_the_same(tmp_path, content):
    path = tmp_path / ("x" * 200 + ".yaml")
    path.write_text(content)
    assert check_rig(rig_name(path)) == "rig_" + "x" * 116


def test_all_bad_values_are_named_at_once(tmp_path):
    content = changed(["substeps"], 0) | {"colour": "red"}
    with pytest.raises(SpecimenError, match=r"substeps is 0; .*; unknown key 'colour'; allowed: .*"):
        load_specimen(written(tmp_path, content))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("a: [", "is not YAML"),
        ("name: 2024-02-30", "is not YAML: '2024-02-30' cannot be read as timestamp"),
        ("name: " + "[" * 3_000, "is not YAML: lists and mappings stand 101 deep"),
        ("- a\n- b", r"the document is \['a', 'b'\]"),
        ("", "the document is empty"),
    ],
)
def test_a_file_that_is_no_specimen_is_refused(tmp_path, content, said):
    with pytest.raises(SpecimenError, match=said):
        load_specimen(written(tmp_path, content))


def test_a_file_that_is_not_there_or_not_text_is_named(tmp_path):
    with pytest.raises(SpecimenError, match=r"specimen none\.yaml cannot be read: No such file or directory\."):
        load_specimen(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SpecimenError, match=r"specimen binary\.yaml is not text in UTF-8\."):
        load_specimen(tmp_path / "binary.yaml")


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (["sdf"], "other.sdf", ["the SDF other.sdf is missing"]),
        (["struts", 0, "body_a"], "left_arm", ["body 'left_arm' is not in the specimen", "left_lower_arm"]),
        (["rubber", 0, "frame_c"], "left_eye", ["frame 'left_eye' is not in the specimen"]),
        (["rubber", 0, "frame_c"], "left_lower_rear_mount", ["has both frames on 'body'"]),
        (["actuators", 0, "joint"], "left_upper_hinge", ["which is revolute; a cylinder needs a prismatic joint"]),
        (["actuators", 0, "joint"], "left_stroke", ["joint 'left_stroke' is not in the specimen"]),
        (
            ["actuators", 0, "joint"],
            "left_lateral_stroke",
            ["two joints of actuators are called 'left_lateral_stroke'"],
        ),
        (["actuators", 0, "kind"], "steep", ["is of kind 'steep'; actuator_kinds has vertical, lateral, longitudinal"]),
        (["supply"], None, ["has actuators but no supply"]),
        (["responses", 0, "transducer"], "left_lower_ball", ["which is ball; a wheel-force transducer is a weld"]),
        (["responses", 0, "transducer"], "body_clamp", ["hangs on 'body'; behind a wheel-force transducer"]),
        (["responses", 0, "name"], "left_lateral", ["two responses are called 'left_lateral'"]),
        (["drives", 0, "name"], "left_up", ["its parts take the drives left_vertical [m], left_lateral [m]"]),
        (["actuators", 0, "name"], "left_lateral", ["two parts are called 'left_lateral'"]),
        (["drives", 1, "maximum"], 0.08, ["goes from -0.065 to 0.08 m; its cylinder ends at 0.075 m either way"]),
    ],
)
def test_a_part_that_does_not_fit_the_sdf_is_named(tmp_path, path, value, said):
    with pytest.raises(SpecimenError) as caught:
        load_rig(written(tmp_path, changed(path, value)))
    message = str(caught.value)
    assert message.startswith("specimen front_axle: ")
    assert message.endswith(".")
    for part in said:
        assert part in message


def test_drives_in_another_order_than_the_parts_are_refused(tmp_path):
    content = document()
    content["drives"][0], content["drives"][1] = content["drives"][1], content["drives"][0]
    with pytest.raises(SpecimenError, match="in this order; listed are left_lateral"):
        load_rig(written(tmp_path, content))


def test_a_tyres_drives_carry_their_units(tmp_path):
    content = changed(["tyres", 0, "drives"], ["left_slope", "left_height", "left_camber", "left_speed"], "predecessor")
    with pytest.raises(SpecimenError, match=r"take the drives left_slope \[m\], left_height \[1\]"):
        load_rig(written(tmp_path, content, "predecessor"))


def test_a_mirrored_part_is_a_mirror_image(front_axle):
    oblique = front_axle.specimen.rubber[2].model_copy(update={"axis": (3.0, 4.0, 0.0)})
    tree = front_axle.model.assembly.tree
    assembly = assemble(front_axle.specimen.model_copy(update={"rubber": (oblique,)}), tree)
    elements = {element.name: element for element in assembly.elements}
    np.testing.assert_allclose(elements["left_lower_rear_y"].axis, [0.6, 0.8, 0.0])
    np.testing.assert_allclose(elements["right_lower_rear_y"].axis, [0.6, -0.8, 0.0])
    left, right = elements["left_strut"], elements["right_strut"]
    assert tree.bodies[right.body_a].name == "right_lower_arm"
    assert right.body_b == left.body_b
    np.testing.assert_allclose(right.point_b, left.point_b * [1, -1, 1])
    assert right.design_length == pytest.approx(left.design_length)


def test_what_a_rig_answers_has_a_hash_of_its_own(tmp_path, front_axle):
    same = load_rig(shipped_specimens()["front_axle"])
    assert same.content_hash == front_axle.content_hash
    other = load_rig(written(tmp_path, changed(["struts", 0, "law", "preload"], 5801.0)))
    assert other.content_hash != same.content_hash
