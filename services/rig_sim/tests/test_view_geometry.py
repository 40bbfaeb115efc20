"""What a 3-D view draws, against the SDF itself and what a rig is."""

from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from duralab_proto.arrays import from_array
from duralab_proto.v1 import rig_pb2
from rig_sim import shipped_specimens
from rig_sim.bus import describe_rig
from rig_sim.compile import FOLDER_VARIABLE
from rig_sim.model.assembly import assemble
from rig_sim.multibody.drake_reader import load_plant, read_tree
from rig_sim.specimen.specimen import load_specimen
from rig_sim.view import view_geometry

CUBE = """v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""
VISUALS = """<visual name="a_box"><pose>0 0 0.5 0 0 0</pose>
<geometry><box><size>0.1 0.2 0.3</size></box></geometry></visual>
<visual name="a_ball"><geometry><sphere><radius>0.2</radius></sphere></geometry></visual>
<visual name="a_mesh"><geometry><mesh><uri>tetrahedron.obj</uri><scale>2 2 2</scale></mesh></geometry></visual>
"""


@pytest.fixture
def described(front_axle):
    return describe_rig(front_axle)


def positions_of(description):
    """Return where the bodies rest, (3,) by name, and rotations, the world among them."""
    poses = from_array(description.rest_poses, field="rest_poses")
    return dict(zip(description.bodies, poses, strict=True))


def in_world(pose, point):
    w, x, y, z = pose[3:]
    vector = np.array([x, y, z])
    return pose[:3] + point + 2.0 * np.cross(vector, np.cross(vector, point) + w * point)


def test_every_visual_of_the_sdf_is_drawn_on_its_body(front_axle):
    root = Xml.parse(shipped_specimens()["front_axle"].with_suffix(".sdf")).getroot()
    wanted = {(link.get("name"), visual.get("name")) for link in root.iter("link") for visual in link.iter("visual")}
    drawn = {(shape.body, shape.name) for shape in front_axle.geometry.shapes}
    assert wanted <= drawn


def test_each_actuator_has_a_cylinder_a_piston_and_a_line(front_axle):
    drives = {channel.name for channel in front_axle.specimen.drives}
    geometry = front_axle.geometry
    assert {link.name for link in geometry.links if link.kind == rig_pb2.LINK_KIND_ACTUATOR} == drives
    assert {shape.name for shape in geometry.shapes if shape.role == rig_pb2.SHAPE_ROLE_CYLINDER} == {
        f"{name}_cylinder" for name in drives
    }
    assert sum(shape.role == rig_pb2.SHAPE_ROLE_PISTON for shape in geometry.shapes) == len(drives)
    assert sum(shape.role == rig_pb2.SHAPE_ROLE_WHEEL for shape in geometry.shapes) == 2


def test_an_actuators_line_is_its_stroke_longer_when_the_piston_moves(front_axle):
    tree = front_axle.model.assembly.tree
    link = next(link for link in front_axle.geometry.links if link.name == "left_vertical")
    joint = tree.joint("left_vertical_stroke")
    lengths = []
    for stroke in (0.0, 0.05):
        positions = tree.default_positions.copy()
        positions[joint.position_start] = stroke
        bodies = dict(enumerate(front_axle.poses.frames(positions[None])[0], start=1))
        head = bodies[joint.child][9:]
        lengths.append(np.linalg.norm(head - from_array(link.point_a, field="point_a")))
    # From the foot to the piston's head: the head comes out by the stroke.
    assert lengths[1] - lengths[0] == pytest.approx(0.05)
    # Half-way the head stands three half strokes of 0.125 m from the foot.
    assert lengths[0] == pytest.approx(0.375)


def test_at_rest_a_strut_reaches_from_the_arm_to_the_body(described):
    poses = positions_of(described)
    strut = next(link for link in described.links if link.name == "left_strut")
    assert strut.kind == rig_pb2.LINK_KIND_STRUT
    ends = [
        in_world(poses[body], from_array(point, field="point")) if body else from_array(point, field="point")
        for body, point in ((strut.body_a, strut.point_a), (strut.body_b, strut.point_b))
    ]
    # Where the YAML puts it at design; the rest lies within centimetres of it.
    np.testing.assert_allclose(ends, [[0.0, 0.6, 0.205], [-0.01, 0.5, 0.64]], atol=0.03)


def test_the_left_and_the_right_are_mirror_images(described):
    poses = positions_of(described)
    solids = {shape.name: shape for shape in described.shapes}
    for name, shape in solids.items():
        if not name.startswith("left_"):
            continue
        other = solids[name.replace("left_", "right_", 1)]
        here, there = (
            in_world(poses[item.body], from_array(item.pose, field="pose")[:3])
            if item.body
            else from_array(item.pose, field="pose")[:3]
            for item in (shape, other)
        )
        np.testing.assert_allclose(here * [1.0, -1.0, 1.0], there, atol=1e-6)


@pytest.fixture
def own_specimen(tmp_path):
    """SDF and assembly of a specimen with further visuals, among them a mesh."""
    path = shipped_specimens()["front_axle_compliant"]
    text = path.with_name("front_axle.sdf").read_text()
    body = text.index('<link name="rack">')
    place = text.index("<visual", body)
    (tmp_path / "front_axle.sdf").write_text(text[:place] + VISUALS + text[place:])
    (tmp_path / "front_axle.yaml").write_text(path.read_text())
    (tmp_path / "tetrahedron.obj").write_text(CUBE)
    sdf = tmp_path / "front_axle.sdf"
    return sdf, assemble(load_specimen(tmp_path / "front_axle.yaml"), read_tree(load_plant(sdf)))


def test_boxes_spheres_and_meshes_of_a_specimen_of_ones_own_are_drawn(own_specimen):
    solids = {shape.name: shape for shape in view_geometry(*own_specimen, key="own").shapes}
    box, mesh = solids["a_box"].box, solids["a_mesh"].mesh
    np.testing.assert_allclose([box.x, box.y, box.z], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(from_array(solids["a_box"].pose, field="pose")[:3], [0.0, 0.0, 0.5])
    assert solids["a_ball"].sphere.radius == pytest.approx(0.2)
    assert len(mesh.corners) == 3 * 4
    vertices = from_array(mesh.vertices, field="vertices")
    np.testing.assert_allclose(sorted(map(tuple, vertices)), [(0, 0, 0), (0, 0, 2), (0, 2, 0), (2, 0, 0)])


def test_what_is_kept_on_disk_is_what_drake_read(front_axle, tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    sdf, assembly = shipped_specimens()["front_axle"].with_suffix(".sdf"), front_axle.model.assembly
    read = view_geometry(sdf, assembly, key="own")
    (kept,) = tmp_path.iterdir()
    monkeypatch.setattr("rig_sim.view.Parser", None)
    assert view_geometry(sdf, assembly, key="own") == read == front_axle.geometry
    kept.write_bytes(kept.read_bytes()[:-1])
    with pytest.raises(TypeError, match="not callable"):
        view_geometry(sdf, assembly, key="own")


def test_a_mesh_is_read_again(own_specimen):
    before = view_geometry(*own_specimen, key="own")
    mesh = own_specimen[0].with_name("tetrahedron.obj")
    mesh.write_text(mesh.read_text().replace("v 1 0 0", "v 3 0 0"))
    assert view_geometry(*own_specimen, key="own") != before
