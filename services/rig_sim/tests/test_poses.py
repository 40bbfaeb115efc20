"""Poses for a view: against Drake, and quaternions against scipy in every corner."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.multibody.tree import BodyIndex
from scipy.spatial.transform import Rotation

import duralab_gateway.publishing
from duralab_gateway.motion import to_poses
from duralab_gateway.publishing import PoseStream
from rig_sim import shipped_specimens
from rig_sim.checks.proof import random_state
from rig_sim.multibody.drake_reader import load_plant


def test_poses_are_drakes(rig):
    plant = load_plant(shipped_specimens()[rig.specimen.name].with_suffix(".sdf"))
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(1)
    instants = np.array([random_state(rig.model, rng)[: rig.model.position_count] for _ in range(5)])
    for positions, poses in zip(instants, to_poses(rig.poses.frames(instants)), strict=True):
        plant.SetPositions(context, positions)
        for index, name in enumerate(rig.poses.bodies):
            body = plant.get_body(BodyIndex(index + 1))
            assert body.name() == name
            right = plant.EvalBodyPoseInWorld(context, body)
            np.testing.assert_allclose(poses[index, :3], right.translation(), atol=1e-12)
            matrix = Rotation.from_quat(poses[index, [4, 5, 6, 3]]).as_matrix()
            np.testing.assert_allclose(matrix, right.rotation().matrix(), atol=1e-12)


def test_quaternions_are_right_in_every_corner():
    halves = Rotation.from_rotvec(np.pi * np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.8, 0.0]]]))
    some = Rotation.concatenate([halves, Rotation.random(200, random_state=0), Rotation.identity()])
    frames = np.concatenate([some.as_matrix().reshape(-1, 1, 9), np.ones((len(some), 1, 3))], axis=2)
    quaternions = to_poses(frames)[:, 0, 3:]
    assert (quaternions[:, 0] >= 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-14)
    back = Rotation.from_quat(quaternions[:, [1, 2, 3, 0]])
    np.testing.assert_allclose((back.inv() * some).magnitude(), 0.0, atol=1e-7)


class Wire:
    """A bus and its publisher that keep what is put."""

    def __init__(self):
        self.keys, self.sent = self, []

    def rig_pose(self, rig):
        return rig

    def publisher(self, key, *, spools):
        return self

    def put(self, message):
        self.sent.append(message)


@pytest.mark.parametrize(("speed", "most", "messages"), [(1.0, 11, 120), (4.0, 45, 30), (100.0, 50, 24)])
def test_poses_are_published_six_times_a_second_or_in_blocks_of_50(monkeypatch, front_axle, speed, most, messages):
    now, wire = 0.0, Wire()
    monkeypatch.setattr(duralab_gateway.publishing, "time", SimpleNamespace(monotonic=lambda: now))
    stream = PoseStream(wire, "front_axle")
    frames = front_axle.poses.frames(front_axle.rest[None, : front_axle.model.position_count])
    for sample in range(1, 1201):
        now = sample / 60.0 / speed
        stream.add([sample], 60.0 - 1e-6, lambda _instants: frames)
    stream.flush()
    sizes = [len(np.frombuffer(block.time.data)) for block in wire.sent]
    assert sum(sizes) == 1200
    assert max(sizes) <= most
    assert len(sizes) == pytest.approx(messages, rel=0.1)


def test_no_more_than_sixty_poses_a_second_are_published(front_axle):
    wire = Wire()
    stream = PoseStream(wire, "front_axle")
    stream.begin("a")
    rest = front_axle.rest[None, : front_axle.model.position_count]
    # One sample at a time, and ten in a block.
    for first in [*range(1, 1000), *range(1000, 2000, 10)]:
        block = range(first, first + (10 if first >= 1000 else 1))
        stream.add(block, 1000.0, lambda wanted: np.repeat(front_axle.poses.frames(rest), len(wanted), axis=0))
    stream.flush()
    times = np.concatenate([np.frombuffer(block.time.data) for block in wire.sent])
    assert 110 <= len(times) <= 120
    assert np.diff(times).min() >= 1.0 / 60.0
    assert {block.run for block in wire.sent} == {"a"}
