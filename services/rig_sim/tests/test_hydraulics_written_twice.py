"""An actuator with a mass, written a second time from the textbook in plain SI, against the element of the rigs.

Nothing of the product's equations is called by the second right-hand side: it goes through the four metering edges
between supply, chambers and tank one by one, keeps pressures in pascals and speeds in their own units, and has
functions of its own for friction, cushions and control. Sources: Merritt, *Hydraulic Control Systems*, chapters 3, 5
and 6; Jelali and Kroll, *Hydraulic Servo-systems*, chapter 4 (friction).
"""

from math import exp, pi, sqrt, tanh
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig_sim.effect import Effect, Line
from rig_sim.hydraulics.actuator import DisplacementActuator
from rig_sim.hydraulics.cylinder import Cushion, Cylinder
from rig_sim.hydraulics.loops import DisplacementLoop
from rig_sim.hydraulics.servovalve import Servovalve

SUPPLY, TANK, MASS = 280e5, 5e5, 60.0

PLAIN = DisplacementActuator(
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
FURNISHED = DisplacementActuator(
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


def command(time):
    """Return the wanted stroke in m: up to 42 mm with a ripple, smooth from rest on."""
    begin = 0.5 - 0.5 * np.cos(pi * min(time / 0.05, 1.0))
    return begin * (0.035 * np.sin(2 * pi * 4.0 * time) + 0.007 * np.sin(2 * pi * 17.0 * time))


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


def textbook(actuator, time, state):
    """Rates of stroke, speed, spool, spool speed, pilot, both pressures, mean load pressure, integral, filter."""
    valve, c, loop = actuator.valve, actuator.cylinder, actuator.loop
    x, v, spool, spool_speed, pilot, p_a, p_b, p_slow, integral, followed, followed_rate = state
    area_a, area_b = c.area, c.rod_side_area or c.area
    p_load = p_a - p_b * area_b / area_a
    # Controller: PID with feed-forward of the filtered command, pressure feedback through a high-pass.
    wanted = command(time)
    w_f = 2 * pi * loop.command_filter
    followed_acceleration = w_f**2 * (wanted - followed) - sqrt(2.0) * w_f * followed_rate
    u = loop.proportional * (wanted - x) + loop.integral * integral - loop.pressure_feedback * (p_load - p_slow)
    u += loop.velocity_feedforward * followed_rate + loop.acceleration_feedforward * followed_acceleration
    u -= loop.derivative * v
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
    force = p_a * area_a - p_b * area_b - friction(c, v) + cushions(c, x, v)
    return [
        v,
        force / MASS,
        spool_speed,
        spool_acceleration,
        2 * pi * valve.pilot_frequency * (asked - pilot),
        c.bulk_modulus / volume_a * (supply_to_a - a_to_tank - leak - area_a * v),
        c.bulk_modulus / volume_b * (supply_to_b - b_to_tank + leak + area_b * v),
        2 * pi * loop.pressure_corner * (p_load - p_slow),
        0.0 if windup else wanted - x,
        followed_rate,
        followed_acceleration,
    ]


def element(actuator, time, state):
    """Rates of stroke and speed, then of the element's own states."""
    effect = Effect([], [0.0], lines={"unit": Line(SUPPLY, TANK)})
    motion = SimpleNamespace(joint_positions=state[:1], joint_velocities=state[1:2])
    own = actuator.apply(motion, state[2:], [command(time)], effect)
    return [state[1], effect.joint_forces[0] / MASS, *own]


TIMES = np.linspace(0.0, 0.3, 1201)


def solved(rates, start, scale):
    run = solve_ivp(
        rates, (0.0, TIMES[-1]), start, t_eval=TIMES, method="DOP853", rtol=1e-10, atol=1e-11 * scale, max_step=1e-3
    )
    assert run.success
    return run.y


@pytest.mark.parametrize("actuator", [PLAIN, FURNISHED], ids=lambda actuator: actuator.name)
def test_the_second_writing_gives_the_same_trajectories(actuator):
    pilot = actuator.valve.pilot_frequency > 0.0
    own_start = np.array([0.0, 0.0, *actuator.initial_state])
    own = solved(lambda t, y: element(actuator, t, y), own_start, np.ones(len(own_start)))
    p_a, p_b = 1e6 * own_start[4 + pilot : 6 + pilot]
    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, p_a, p_b, 0.0, 0.0, 0.0, 0.0])
    scale = np.array([1.0, 1.0, 1.0, 1e3, 1.0, 1e6, 1e6, 1e6, 1.0, 1.0, 1.0])
    book = solved(lambda t, y: textbook(actuator, t, y), start, scale)
    for name, ours, theirs in (
        ("stroke", own[0], book[0]),
        ("speed", own[1], book[1]),
        ("spool", own[2], book[2]),
        ("pressure A", 1e6 * own[4 + pilot], book[5]),
        ("pressure B", 1e6 * own[5 + pilot], book[6]),
        ("mean load pressure", 1e6 * own[6 + pilot], book[7]),
        ("integral", own[7 + pilot], book[8]),
    ):
        largest = np.abs(theirs).max()
        assert largest > 0.0, name
        assert np.abs(ours - theirs).max() < 1e-6 * largest, name
    # It was a playback worth comparing: far strokes, work for the valve, and for the second one a cushion.
    assert np.abs(book[0]).max() > (0.02 if actuator is PLAIN else 0.035)
    assert np.abs(book[2]).max() > 0.2
