"""Strut, rubber and tyre against their own laws: continuity, losses, loops, limits."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig_sim.elements.rubber import Rubber, RubberLaw, friction_rate
from rig_sim.elements.strut import Strut, StrutLaw, strut_force
from rig_sim.elements.tyre import Tyre, TyreLaw
from rig_sim.multibody.forces import Effect, Input
from rig_sim.multibody.kinematics import Motion
from rig_sim.multibody.spatial import ZERO, Spatial, cross, rotation_from_roll_pitch_yaw
from rig_sim.multibody.tree import Pose

STRUT = StrutLaw(
    preload=5800.0,
    stiffness=5.2e4,
    progression=4.0e6,
    compression_damping=1700.0,
    rebound_damping=3400.0,
    knee_speed=0.45,
    bump_clearance=0.045,
    bump_stiffness=6.0e6,
    rebound_clearance=0.060,
    rebound_stiffness=8.0e6,
    friction=60.0,
    friction_speed=0.02,
)
RUBBER = RubberLaw(progression=1.0e11, friction=150.0, slip_travel=1.5e-4)
TYRE = TyreLaw(
    free_radius=0.32,
    radial_stiffness=2.1e5,
    radial_damping=150.0,
    cornering_stiffness=5.5e4,
    relaxation_length=0.45,
    half_contact_load=500.0,
)
INPUTS = (Input("height", "m"), Input("slope", "1"), Input("camber", "1"), Input("speed", "m/s"))
SPEED = 15.0


def two_bodies(rng):
    """Return the motion of the world and two bodies, anywhere and moving anyhow."""
    poses, velocities = [Pose(np.eye(3), np.zeros(3))], [ZERO]
    for _ in range(2):
        poses.append(Pose(rotation_from_roll_pitch_yaw(rng.normal(size=3)), rng.normal(size=3)))
        velocities.append(Spatial(rng.normal(size=3), rng.normal(size=3)))
    return Motion(poses, velocities, [], [], [], np.zeros(0), np.zeros(0))


def later(motion, seconds):
    """Return the same bodies a moment later, at the same velocities (first order)."""
    poses = []
    for pose, velocity in zip(motion.poses, motion.velocities, strict=True):
        turned = pose.rotation + seconds * np.array([cross(velocity.angular, column) for column in pose.rotation.T]).T
        poses.append(Pose(turned, pose.origin + seconds * velocity.at(pose.origin)))
    return Motion(poses, motion.velocities, [], [], [], np.zeros(0), np.zeros(0))


def power(motion, effect):
    return sum(velocity.power(wrench) for velocity, wrench in zip(motion.velocities, effect.wrenches, strict=True))


def test_strut_force_is_continuous_and_grows_with_compression_and_speed():
    compression = np.linspace(-0.1, 0.09, 20001)
    for speed in (-1.0, -0.01, 0.0, 0.3):
        force = strut_force(STRUT, compression, np.full_like(compression, speed))
        assert np.all(np.diff(force) > 0.0)
        # The steepest it may be: progressive spring and a stop; a jump would be steeper.
        steepest = STRUT.stiffness + 3 * STRUT.progression * 0.1**2 + 2 * STRUT.rebound_stiffness * 0.040
        assert np.diff(force).max() <= 1.01 * steepest * (compression[1] - compression[0])
    speed = np.linspace(-2.0, 2.0, 20001)
    assert np.all(np.diff(strut_force(STRUT, np.zeros_like(speed), speed)) > 0.0)


def test_strut_force_at_design_height_and_in_its_stops():
    assert strut_force(STRUT, 0.0, 0.0) == STRUT.preload
    assert strut_force(STRUT, 0.055, 0.0) == pytest.approx(5800 + 0.055 * (5.2e4 + 4e6 * 0.055**2) + 6e6 * 0.01**2)
    assert strut_force(STRUT, -0.080, 0.0) == pytest.approx(5800 - 0.08 * (5.2e4 + 4e6 * 0.08**2) - 8e6 * 0.02**2)


def test_strut_damper_is_digressive_and_differs_by_direction():
    # At the knee the damper has lost half of its small-speed rate; friction is full there.
    compression, rebound = strut_force(STRUT, 0.0, 0.45) - 5800, strut_force(STRUT, 0.0, -0.45) - 5800
    assert compression == pytest.approx(0.5 * 1700 * 0.45 + 60)
    assert rebound == pytest.approx(-(0.5 * 3400 * 0.45 + 60))


def test_a_strut_takes_from_the_bodies_what_its_spring_does_not_store():
    rng = np.random.default_rng(1)
    strut = Strut("strut", 1, np.array([0.1, 0.2, 0.0]), 2, np.array([0.0, -0.1, 0.3]), 1.0, STRUT)
    for _ in range(50):
        motion = two_bodies(rng)
        ends = [motion.point(body, point)[0] for body, point in ((1, strut.point_a), (2, strut.point_b))]
        effect = Effect([ZERO] * 3, [])
        assert strut.apply(motion, np.zeros(0), np.zeros(0), effect) == []
        lengths = []
        for moved in (later(motion, -1e-7), later(motion, 1e-7)):
            a, b = moved.point(1, strut.point_a)[0], moved.point(2, strut.point_b)[0]
            lengths.append(np.linalg.norm(b - a))
        speed = -(lengths[1] - lengths[0]) / 2e-7
        compression = 1.0 - np.linalg.norm(ends[1] - ends[0])
        assert power(motion, effect) == pytest.approx(-strut_force(STRUT, compression, speed) * speed, rel=1e-5)
        # What is not spring only ever takes.
        assert (strut_force(STRUT, compression, speed) - strut_force(STRUT, compression, 0.0)) * speed >= 0.0
        np.testing.assert_allclose(effect.wrenches[1].linear, -effect.wrenches[2].linear)


def test_rubber_friction_is_a_loop_of_the_analytic_area():
    # Bouc-Wen with exponent 1 between -X and X: area = 4 F (X - d tanh(X/d)).
    amplitude = 4e-4
    omega = 2 * np.pi * 2.0
    time = np.linspace(0.0, 2.0, 40001)

    def rate(t, level):
        return friction_rate(RUBBER, level, amplitude * omega * np.cos(omega * t))

    level = solve_ivp(rate, (0, 2.0), [0.0], t_eval=time, rtol=1e-9, atol=1e-11, max_step=1e-3).y[0]
    travel = amplitude * np.sin(omega * time)
    last = time >= 1.5  # one steady cycle
    area = np.trapezoid(RUBBER.friction * level[last], travel[last])
    d = RUBBER.slip_travel
    assert area == pytest.approx(4 * RUBBER.friction * (amplitude - d * np.tanh(amplitude / d)), rel=1e-4)
    assert np.abs(level).max() <= 1.0
    assert level[last].max() == pytest.approx(np.tanh(amplitude / d), rel=1e-4)


def test_rubber_friction_stays_within_its_limit_whatever_is_done_to_it():
    rng = np.random.default_rng(3)
    level = 0.0
    for speed in rng.normal(scale=0.5, size=4000):
        for _ in range(4):
            level += 2.5e-6 * friction_rate(RUBBER, level, speed)
        assert abs(level) <= 1.0


def test_rubber_is_an_extra_spring_while_it_sticks():
    assert RUBBER.friction * friction_rate(RUBBER, 0.0, 1.0) == pytest.approx(RUBBER.friction / RUBBER.slip_travel)


def test_rubber_takes_or_stores_what_the_bodies_lose():
    rng = np.random.default_rng(5)
    for _ in range(30):
        motion = two_bodies(rng)
        frame = Pose(rotation_from_roll_pitch_yaw(rng.normal(size=3)), rng.normal(size=3))
        rubber = Rubber("rubber", 1, frame, 2, rng.normal(size=3), np.array([0.6, 0.0, 0.8]), RUBBER)
        effect = Effect([ZERO] * 3, [])
        (rate,) = rubber.apply(motion, np.array([0.4]), np.zeros(0), effect)

        def travel(moved, rubber=rubber):
            pose = moved.poses[1] @ rubber.frame_a
            return rubber.axis @ pose.rotation.T @ (moved.point(2, rubber.point_c)[0] - pose.origin)

        speed = (travel(later(motion, 1e-7)) - travel(later(motion, -1e-7))) / 2e-7
        assert rate == pytest.approx(friction_rate(RUBBER, 0.4, speed), rel=1e-5)
        force = RUBBER.progression * travel(motion) ** 3 + RUBBER.friction * 0.4
        assert power(motion, effect) == pytest.approx(-force * speed, rel=1e-5)


def wheel_at(height, velocity=(0.0, 0.0, 0.0)):
    poses = [Pose(np.eye(3), np.zeros(3)), Pose(np.eye(3), np.array([0.2, 0.7, height]))]
    return Motion(poses, [ZERO, Spatial(np.zeros(3), np.array(velocity))], [], [], [], np.zeros(0), np.zeros(0))


def on_road(motion, *, side=0.0, height=0.0, slope=0.0, camber=0.0, speed=SPEED):
    effect = Effect([ZERO] * 2, [])
    tyre = Tyre("tyre", 1, TYRE, INPUTS)
    (rate,) = tyre.apply(motion, np.array([side]), np.array([height, slope, camber, speed]), effect)
    return effect.wrenches[1], rate


def test_a_tyre_bears_its_load_at_the_static_deflection():
    load = 4000.0
    wrench, rate = on_road(wheel_at(TYRE.free_radius - load / TYRE.radial_stiffness))
    np.testing.assert_allclose(wrench.linear, [0.0, 0.0, load], rtol=1e-12)
    assert rate == 0.0
    # The force acts below the wheel's centre.
    np.testing.assert_allclose(wrench.angular, cross(np.array([0.2, 0.7, 0.0]), wrench.linear))


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.0, 2.0, 1.0)])
def test_a_tyre_in_the_air_has_no_force_and_loses_its_side_force(velocity):
    wrench, rate = on_road(wheel_at(0.33, velocity), camber=0.05, slope=0.02)
    np.testing.assert_array_equal(wrench.linear, 0.0)
    assert rate == 0.0
    _, rate = on_road(wheel_at(0.33, velocity), side=1.0)
    assert rate == pytest.approx(-SPEED / TYRE.relaxation_length)


def test_a_slope_pushes_back_a_camber_pushes_down_the_hill():
    motion = wheel_at(0.30)
    uphill, _ = on_road(motion, slope=0.1)
    assert uphill.linear[0] == pytest.approx(-0.1 * uphill.linear[2])
    # Driving uphill the road comes towards the wheel.
    assert uphill.linear[2] == pytest.approx(0.02 * TYRE.radial_stiffness + 0.1 * SPEED * TYRE.radial_damping)
    higher_on_the_left, _ = on_road(motion, camber=0.1)
    assert higher_on_the_left.linear[1] == pytest.approx(-0.1 * higher_on_the_left.linear[2])


def test_side_force_is_against_the_slip_and_builds_up_over_the_relaxation_length():
    load = 0.02 * TYRE.radial_stiffness
    motion = wheel_at(0.30, (0.0, 0.3, 0.0))
    steady = -TYRE.cornering_stiffness * (0.3 / SPEED) * load / (load + TYRE.half_contact_load)
    _, rate = on_road(motion, side=steady / 1e3)
    assert rate == pytest.approx(0.0, abs=1e-9)
    _, rate = on_road(motion)
    assert rate == pytest.approx(steady / 1e3 * SPEED / TYRE.relaxation_length)
    wrench, _ = on_road(motion, side=steady / 1e3)
    assert wrench.linear[1] == pytest.approx(steady)


def test_a_standing_tyre_is_a_spring_against_sideways_motion():
    motion = wheel_at(0.30, (0.0, 0.3, 0.0))
    load = 0.02 * TYRE.radial_stiffness
    stiffness = TYRE.cornering_stiffness * load / (load + TYRE.half_contact_load) / TYRE.relaxation_length
    _, rate = on_road(motion, side=0.7, speed=0.0)
    assert rate == pytest.approx(-1e-3 * stiffness * 0.3)
