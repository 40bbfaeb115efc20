"""An actuator with its load, written a second time from the textbook in plain SI, against the element of the rigs.

In displacement control it moves a mass; in force control its piston pushes a specimen (a mass on a spring) through a
rod with a load cell, uphill.

Nothing of the product's equations is called by the second right-hand side: it goes through the four metering edges
between supply, chambers and tank one by one, keeps pressures in pascals and speeds in their own units, and has
functions of its own for friction, cushions and control. Sources: Merritt, *Hydraulic Control Systems*, chapters 3, 5
and 6; Jelali and Kroll, *Hydraulic Servo-systems*, chapter 4 (friction).
"""

from math import exp, pi, sqrt, tanh

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig_sim.hydraulics.actuator import HydraulicActuator, LoadCell
from rig_sim.hydraulics.cylinder import Cushion, Cylinder
from rig_sim.hydraulics.loops import DisplacementLoop, Feedback, ForceLoop
from rig_sim.hydraulics.servovalve import Servovalve
from rig_sim.multibody.forces import Effect, Line
from rig_sim.multibody.kinematics import Motion
from rig_sim.multibody.spatial import ZERO, Spatial
from rig_sim.multibody.tree import Pose, SpringDamper

SUPPLY, TANK = 280e5, 5e5
#: Of a piston with what is fixed to it; of a specimen that swings at 16 Hz; its spring and damper, the rod's.
MASS, SPECIMEN = 60.0, 40.0
SPRING, DAMPER = 4.0e5, 400.0
ROD, ROD_DAMPER = 3.0e7, 4.0e3
#: The piston goes uphill: gravity along the stroke, in m/s^2.
FALL = -2.0

PLAIN = HydraulicActuator(
    name="plain",
    joint_position=0,
    joint_velocity=0,
    valve=Servovalve(rated_flow=2.0e-3, rated_drop=35e5, spool_frequency=110.0, spool_damping=0.8),
    cylinder=Cylinder(
        area=2e-3,
        half_stroke=0.125,
        dead_volume=5e-5,
        bulk_modulus=1.2e9,
        leakage=1e-11,
        friction=120.0,
        friction_speed=0.01,
    ),
    loop=DisplacementLoop(proportional=40.0, integral=50.0, pressure_feedback=2e-8, pressure_corner=20.0),
    supply="unit",
    middle_pressure=142.5e5,
)
#: A single-rod cylinder on a two-stage valve with overlap and asymmetric lands, sticking seals, cushions, feed-forward.
FURNISHED = HydraulicActuator(
    name="furnished",
    joint_position=0,
    joint_velocity=0,
    valve=Servovalve(
        rated_flow=2.0e-3,
        rated_drop=35e5,
        spool_frequency=140.0,
        spool_damping=0.7,
        largest_opening=0.9,
        overlap=0.02,
        rounding=0.01,
        port_b_gain=0.75,
        pilot_frequency=400.0,
    ),
    cylinder=Cylinder(
        area=2e-3,
        rod_side_area=1.5e-3,
        half_stroke=0.05,
        dead_volume=5e-5,
        bulk_modulus=1.2e9,
        leakage=3e-11,
        friction=120.0,
        friction_speed=0.01,
        stiction=80.0,
        stribeck_speed=0.05,
        viscous_friction=200.0,
        cushion=Cushion(length=0.016, stiffness=2e6, damping=5e3),
    ),
    loop=DisplacementLoop(
        proportional=30.0,
        integral=20.0,
        pressure_feedback=2e-8,
        pressure_corner=10.0,
        derivative=0.3,
        velocity_feedforward=0.5,
        acceleration_feedforward=1e-3,
        command_filter=150.0,
    ),
    supply="unit",
    middle_pressure=142.5e5,
)
#: Force by the chambers' pressures, with integral and feed-forward of the command.
BY_PRESSURE = HydraulicActuator(
    name="by pressure",
    joint_position=0,
    joint_velocity=0,
    valve=PLAIN.valve,
    cylinder=PLAIN.cylinder,
    loop=ForceLoop(
        proportional=1e-5,
        integral=1e-3,
        pressure_feedback=0.0,
        pressure_corner=5.0,
        feedback=Feedback.PRESSURE,
        feedforward=2e-6,
    ),
    supply="unit",
    middle_pressure=142.5e5,
)
#: Force by a load cell in the rod, the specimen's motion compensated, on furnished hydraulics.
BY_LOAD_CELL = HydraulicActuator(
    name="by load cell",
    joint_position=0,
    joint_velocity=0,
    valve=FURNISHED.valve,
    cylinder=FURNISHED.cylinder,
    loop=ForceLoop(
        proportional=1e-5,
        integral=2e-3,
        pressure_feedback=5e-9,
        pressure_corner=2.0,
        rate_feedforward=2e-8,
        velocity_compensation=0.4,
        acceleration_compensation=5e-4,
        motion_filter=300.0,
        command_filter=150.0,
    ),
    supply="unit",
    middle_pressure=142.5e5,
    load_cell=LoadCell(
        rod=SpringDamper("rod", 1, np.zeros(3), 2, np.zeros(3), 1.0, ROD, ROD_DAMPER),
        piston=1,
        joint=0,
        piston_mass=MASS,
        gravity=np.array([FALL, 0.0, -9.6]),
    ),
)


def command(actuator, time):
    """Return the wanted stroke in m or force in N: up to 42 mm or 4.2 kN with a ripple, smooth from rest on."""
    begin = 0.5 - 0.5 * np.cos(pi * min(time / 0.05, 1.0))
    wave = begin * (0.035 * np.sin(2 * pi * 4.0 * time) + 0.007 * np.sin(2 * pi * 17.0 * time))
    return 1e5 * wave if actuator.inputs[0].unit == "N" else wave


def root(drop, rated):
    """Turbulent flow over its rated value, laminar where the drop is below about a hundredth of the rated one."""
    return (drop / rated) / ((drop / rated) ** 2 + 0.01**2) ** 0.25


def edge(valve, travel):
    """Opening of one metering edge: the positive part of what goes beyond the overlap, its corner rounded."""

    def rounded(x):
        return 0.5 * (x + sqrt(x * x + valve.rounding**2))

    return rounded(travel - valve.overlap) / rounded(1.0 - valve.overlap)


def friction(c, v):
    stribeck = c.friction + c.stiction * exp(-((v / c.stribeck_speed) ** 2))
    return stribeck * tanh(v / c.friction_speed) + c.viscous_friction * v


def cushions(c, x, v):
    force = 0.0
    for side in (1.0, -1.0):
        depth = side * x - (c.half_stroke - c.cushion.length) if c.cushion else -1.0
        if depth > 0.0:
            closing = side * v
            damper = c.cushion.damping * depth / c.cushion.length * closing
            force -= side * max(c.cushion.stiffness * depth + damper, 0.0)
    return force


def displacement_controller(loop, *, x, v, p_load, p_slow, command, **_):
    """PID with feed-forward of the filtered command, less the integral's part; a stroke needs nothing else."""
    wanted, followed_rate, followed_acceleration = command
    u = loop.proportional * (wanted - x) - loop.pressure_feedback * (p_load - p_slow) - loop.derivative * v
    u += loop.velocity_feedforward * followed_rate + loop.acceleration_feedforward * followed_acceleration
    return u, wanted - x, 0.0


def force_controller(loop, *, v, force, rod, p_load, p_slow, area, command, given, **_):
    """PI with feed-forward and what was compensated of the motion; how the compensation's filter goes on."""
    wanted, followed_rate, _followed_acceleration = command
    cell = loop.feedback == "load_cell"
    error = wanted - (rod if cell else p_load * area)
    u = loop.proportional * error - loop.pressure_feedback * (p_load - p_slow) + given
    u += loop.feedforward * wanted + loop.rate_feedforward * followed_rate
    # The accelerometer rides on the piston: oil and seals against rod and slope.
    acceleration = (force - rod) / MASS + FALL
    asked = loop.velocity_compensation * v + loop.acceleration_compensation * acceleration
    return u, error, 2 * pi * loop.motion_filter * (asked - given)


def textbook(actuator, time, state):
    """Rates of stroke, speed, spool, its speed, pilot, pressures, mean load pressure, integral, filters, specimen."""
    valve, c, loop = actuator.valve, actuator.cylinder, actuator.loop
    x, v, spool, spool_speed, pilot, p_a, p_b, p_slow, integral, followed, followed_rate, given, y, w = state
    area_a, area_b = c.area, c.rod_side_area or c.area
    p_load = p_a - p_b * area_b / area_a
    force = p_a * area_a - p_b * area_b - friction(c, v) + cushions(c, x, v)
    pushing = actuator.inputs[0].unit == "N"
    rod = ROD * (x - y) + ROD_DAMPER * (v - w) if pushing else 0.0
    # Controller, behind the filter that differentiates its command.
    wanted = command(actuator, time)
    w_f = 2 * pi * loop.command_filter
    followed_acceleration = w_f**2 * (wanted - followed) - sqrt(2.0) * w_f * followed_rate
    seen = {"x": x, "v": v, "force": force, "rod": rod, "p_load": p_load, "p_slow": p_slow, "area": area_a}
    commands = wanted, followed_rate, followed_acceleration
    controller = force_controller if pushing else displacement_controller
    u, error, given_rate = controller(loop, **seen, command=commands, given=given)
    u += loop.integral * integral
    windup = loop.integral == 0.0 or abs(u) > 1.0
    # Valve: first stage, spool, then oil through each of the four edges.
    stop = valve.largest_opening
    asked = min(max(u, -stop), stop)
    towards = pilot if valve.pilot_frequency else asked
    w_s = 2 * pi * valve.spool_frequency
    spool_acceleration = w_s**2 * (towards - spool) - 2 * valve.spool_damping * w_s * spool_speed
    travel = min(max(spool, -stop), stop)
    up, down = edge(valve, travel), edge(valve, -travel)
    q_rated, b_gain = valve.rated_flow, valve.port_b_gain
    supply_to_a = q_rated * up * root(SUPPLY - p_a, valve.rated_drop)
    a_to_tank = q_rated * down * root(p_a - TANK, valve.rated_drop)
    supply_to_b = q_rated * b_gain * down * root(SUPPLY - p_b, valve.rated_drop)
    b_to_tank = q_rated * b_gain * up * root(p_b - TANK, valve.rated_drop)
    # Cylinder: conservation of oil in both chambers, then Newton.
    leak = c.leakage * (p_a - p_b)
    volume_a = c.dead_volume + area_a * (c.half_stroke + x)
    volume_b = c.dead_volume + area_b * (c.half_stroke - x)
    return [
        v,
        (force - rod) / MASS + (FALL if pushing else 0.0),
        spool_speed,
        spool_acceleration,
        2 * pi * valve.pilot_frequency * (asked - pilot),
        c.bulk_modulus / volume_a * (supply_to_a - a_to_tank - leak - area_a * v),
        c.bulk_modulus / volume_b * (supply_to_b - b_to_tank + leak + area_b * v),
        2 * pi * loop.pressure_corner * (p_load - p_slow),
        0.0 if windup else error,
        followed_rate,
        followed_acceleration,
        given_rate,
        w,
        (rod - SPRING * y - DAMPER * w) / SPECIMEN,
    ]


def element(actuator, time, state):
    """Rates of stroke, speed, the specimen's place and speed, then of the element's own states."""
    x, v, y, w = state[:4]
    effect = Effect([], [0.0], lines={"unit": Line(SUPPLY, TANK)})
    ahead = np.array([1.0, 0.0, 0.0])
    poses = [Pose(np.eye(3), place * ahead) for place in (0.0, x, 1.0 + y)]
    velocities = [ZERO, *(Spatial(np.zeros(3), speed * ahead) for speed in (v, w))]
    motion = Motion(poses, velocities, [[Spatial(np.zeros(3), ahead)]], [], [], state[:1], state[1:2])
    own = actuator.apply(motion, state[4:], [command(actuator, time)], effect)
    force, slope = effect.joint_forces[0], 0.0
    if actuator.inputs[0].unit == "N":
        push = BY_LOAD_CELL.load_cell.read(motion)
        force, slope = force - push, FALL
        return [v, force / MASS + slope, w, (push - SPRING * y - DAMPER * w) / SPECIMEN, *own]
    return [v, force / MASS, 0.0, 0.0, *own]


TIMES = np.linspace(0.0, 0.3, 1201)


def solved(rates, start, scale):
    run = solve_ivp(
        rates, (0.0, TIMES[-1]), start, t_eval=TIMES, method="DOP853", rtol=1e-10, atol=1e-11 * scale, max_step=1e-3
    )
    assert run.success
    return run.y


@pytest.mark.parametrize("actuator", [PLAIN, FURNISHED, BY_PRESSURE, BY_LOAD_CELL], ids=lambda actuator: actuator.name)
def test_the_second_writing_gives_the_same_trajectories(actuator):
    pilot = actuator.valve.pilot_frequency > 0.0
    own_start = np.array([0.0, 0.0, 0.0, 0.0, *actuator.initial_state])
    own = solved(lambda t, y: element(actuator, t, y), own_start, np.ones(len(own_start)))
    p_a, p_b = 1e6 * own_start[6 + pilot : 8 + pilot]
    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, p_a, p_b, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    unit = actuator.loop.integral_unit
    scale = np.array([1.0, 1.0, 1.0, 1e3, 1.0, 1e6, 1e6, 1e6, unit, unit, 1e3 * unit, 1.0, 1.0, 1.0])
    book = solved(lambda t, y: textbook(actuator, t, y), start, scale)
    compared = [
        ("stroke", own[0], book[0]),
        ("speed", own[1], book[1]),
        ("spool", own[4], book[2]),
        ("pressure A", 1e6 * own[6 + pilot], book[5]),
        ("pressure B", 1e6 * own[7 + pilot], book[6]),
        ("mean load pressure", 1e6 * own[8 + pilot], book[7]),
        ("integral", unit * own[9 + pilot], book[8]),
    ]
    if actuator.inputs[0].unit == "N":
        compared += [("place of the specimen", own[2], book[12]), ("its speed", own[3], book[13])]
    if actuator is BY_LOAD_CELL:
        compared.append(("compensated", own[-1], book[11]))
    for name, ours, theirs in compared:
        largest = np.abs(theirs).max()
        assert largest > 0.0, name
        assert np.abs(ours - theirs).max() < 1e-6 * largest, name
    # It was a playback worth comparing: far strokes, work for the valve, and for the furnished one a cushion.
    assert np.abs(book[0]).max() > {"plain": 0.02, "furnished": 0.035}.get(actuator.name, 0.005)
    assert np.abs(book[2]).max() > 0.2
    if actuator.inputs[0].unit == "N":
        assert ROD * np.abs(book[0] - book[12]).max() > 2000.0
