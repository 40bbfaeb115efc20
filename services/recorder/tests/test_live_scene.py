import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from duralab_proto.arrays import ArrayError, from_array, to_array
from duralab_proto.v1 import rig_pb2
from recorder.live.scene import chained, line_ends, outline_of, read_scene, solid_poses, turned, with_world


def some_quaternions(seed, count=50):
    return np.roll(Rotation.random(count, random_state=seed).as_quat(), 1, axis=1)


def rotation(quaternions):
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1))


def test_turning_and_chaining_are_scipys():
    outer, inner = some_quaternions(1), some_quaternions(2)
    vectors = np.random.default_rng(3).standard_normal((50, 3))
    np.testing.assert_allclose(turned(outer, vectors), rotation(outer).apply(vectors), atol=1e-12)
    both = (rotation(outer) * rotation(inner)).apply(vectors)
    np.testing.assert_allclose(turned(chained(outer, inner), vectors), both, atol=1e-12)


def test_solids_and_lines_move_with_their_bodies_and_the_world_stands_still(campaign):
    scene = read_scene(campaign.description())
    assert scene is not None
    block = campaign.poses("demo.i01", lift=0.3)
    poses = with_world(from_array(block.poses, field="poses"))
    centres, _ = solid_poses(poses, scene.solids)
    rod, rim, ball, _plate = np.moveaxis(centres, 1, 0)
    assert rim[-1, 2] - rim[0, 2] == pytest.approx(0.3)
    np.testing.assert_array_equal(rod, 0.0)
    np.testing.assert_array_equal(ball, 0.0)
    ends = line_ends(poses, scene.lines)[:, 0]
    # From the foot in the world, a metre below, to the wheel.
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), 1.8 + 0.3 * np.linspace(0, 1, 20))


def test_the_outline_holds_the_rig(campaign):
    scene = read_scene(campaign.description())
    assert scene is not None
    outline = outline_of(scene)
    # The line's foot, the box's far corner and the plate's ones, whichever way they are turned.
    for point in ([0.0, 0.0, -1.0], [0.25, 0.1, 1.05], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
        assert np.linalg.norm(np.array(point) - outline.centre) <= outline.radius
    assert outline.radius < 2.0


def test_a_rig_without_looks_is_none(campaign):
    description = campaign.description()
    del description.shapes[:]
    del description.links[:]
    assert read_scene(description) is None


def spoil_body(description):
    description.shapes[0].body = "nobody"


def spoil_form(description):
    description.shapes[0].ClearField("solid")


def spoil_pose(description):
    description.shapes[0].pose.CopyFrom(to_array(np.zeros(6)))


def spoil_mesh(description):
    description.shapes[3].mesh.corners.extend([0, 1, 7])


def spoil_point(description):
    description.links[0].point_b.CopyFrom(to_array(np.full(3, np.nan)))


def spoil_rest(description):
    description.rest_poses.CopyFrom(to_array(np.zeros((3, 7))))


@pytest.mark.parametrize(
    ("spoil", "field"),
    [
        (spoil_body, r"shapes\[0\].body is 'nobody'"),
        (spoil_form, r"shapes\[0\] has no form"),
        (spoil_pose, r"shapes\[0\].pose"),
        (spoil_mesh, r"shapes\[3\].mesh.corners"),
        (spoil_point, r"links\[0\].point_b"),
        (spoil_rest, "rest_poses"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(campaign, spoil, field):
    description = rig_pb2.RigDescription()
    description.CopyFrom(campaign.description())
    spoil(description)
    with pytest.raises(ArrayError, match=field):
        read_scene(description)
