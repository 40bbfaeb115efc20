"""Valve, cylinder and loop against the textbook, and the energy that goes through them."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import find_peaks

from rig_sim.hydraulics.actuator import HydraulicActuator
from rig_sim.hydraulics.cylinder import Cylinder, piston_force, pressure_rates
from rig_sim.hydraulics.loops import DisplacementLoop
from rig_sim.hydraulics.servovalve import Servovalve, port_flows, spool_rates
from rig_sim.hydraulics.supply import Supply
from rig_sim.multibody.forces import Effect, Line

SUPPLY, BACK = 280e5, 5e5
VALVE = Servovalve(rated_flow=2.0e-3, rated_drop=35e5, spool_frequency=110.0, spool_damping=0.8)
CYLINDER = Cylinder(
    area=2e-3,
    half_stroke=0.125,
    dead_volume=5e-5,
    bulk_modulus=1.2e9,
    leakage=1e-11,
    friction=120.0,
    friction_speed=0.01,
)
LOOP = DisplacementLoop(proportional=40.0, integral=50.0, pressure_feedback=2e-8, pressure_corner=20.0)
MASS = 60.0


@pytest.mark.parametrize("opening", [0.1, 0.5, 1.0, -0.3, -1.0])
def test_flow_follows_the_square_root_of_the_drop_over_each_edge(opening):
    a, b = 180e5, 60e5
    into_a, out_of_b, drawn = port_flows(VALVE, opening, (a, b), SUPPLY, BACK)
    drops = (SUPPLY - a, b - BACK) if opening > 0 else (a - BACK, SUPPLY - b)
    expected = [VALVE.rated_flow * opening * np.sqrt(drop / VALVE.rated_drop) for drop in drops]
    # Smoothing at zero drop costs 1e-4/4 of the square of the rated drop over the drop.
    np.testing.assert_allclose([into_a, out_of_b], expected, rtol=1e-4)
    assert drawn == (into_a if opening > 0 else -out_of_b)


def test_rated_flow_is_the_flow_at_the_rated_drop():
    into_a, _, _ = port_flows(VALVE, 1.0, (SUPPLY - VALVE.rated_drop, 0.0), SUPPLY, BACK)
    assert into_a == pytest.approx(VALVE.rated_flow, rel=3e-5)


def test_oil_flows_back_when_a_chamber_is_above_the_supply():
    into_a, _, _ = port_flows(VALVE, 0.5, (SUPPLY + 20e5, BACK), SUPPLY, BACK)
    assert into_a == pytest.approx(-0.5 * VALVE.rated_flow * np.sqrt(20 / 35), rel=1e-4)


def test_flow_crosses_zero_drop_smoothly_and_always_downhill():
    pressures = np.linspace(SUPPLY - 5e5, SUPPLY + 5e5, 2001)
    flows = np.array([port_flows(VALVE, 1.0, (p, 0.0), SUPPLY, BACK)[0] for p in pressures])
    assert np.all(np.diff(flows) < 0.0)
    assert flows[1000] == 0.0
    np.testing.assert_allclose(flows, -flows[::-1], rtol=0, atol=1e-18)


@pytest.mark.parametrize("opening", [1.3, -7.0])
def test_a_valve_opens_no_further_than_its_stop(opening):
    pressures = (150e5, 130e5)
    assert port_flows(VALVE, opening, pressures, SUPPLY, BACK) == port_flows(
        VALVE, np.sign(opening), pressures, SUPPLY, BACK
    )


def test_the_spool_is_a_second_order_system_that_stops_at_full_opening():
    def rates(_, state):
        return spool_rates(VALVE, 3.0, state)

    time = np.linspace(0.0, 0.02, 400)
    spool = solve_ivp(rates, (0, 0.02), [0.0, 0.0], t_eval=time, rtol=1e-10, atol=1e-12).y[0]
    omega, zeta = 2 * np.pi * VALVE.spool_frequency, VALVE.spool_damping
    damped = omega * np.sqrt(1 - zeta**2)
    step = 1 - np.exp(-zeta * omega * time) * (np.cos(damped * time) + zeta * omega / damped * np.sin(damped * time))
    np.testing.assert_allclose(spool, step, rtol=0, atol=1e-8)


def test_leakage_alone_relaxes_the_load_pressure_exponentially():
    # At mid stroke d(a - b)/dt = -2 beta C / V (a - b).
    volume = CYLINDER.dead_volume + CYLINDER.area * CYLINDER.half_stroke
    rate = 2 * CYLINDER.bulk_modulus * CYLINDER.leakage / volume

    def rates(_, pressures):
        return pressure_rates(CYLINDER, 0.0, 0.0, tuple(pressures), (0.0, 0.0))

    solved = solve_ivp(rates, (0.0, 1.0 / rate), [200e5, 80e5], rtol=1e-10, atol=1.0)
    assert np.subtract(*solved.y[:, -1]) == pytest.approx(120e5 / np.e, rel=1e-6)
    assert solved.y[:, -1].sum() == pytest.approx(280e5, rel=1e-9)


@pytest.mark.parametrize("place", [0.0, 0.1, -0.06])
def test_a_mass_on_shut_in_oil_swings_at_the_analytic_frequency(place):
    cylinder = dataclasses.replace(CYLINDER, leakage=0.0, friction=0.0)
    volumes = [cylinder.dead_volume + cylinder.area * (cylinder.half_stroke + sign * place) for sign in (1, -1)]

    def rates(_, state):
        position, speed, a, b = state
        pressures = (a, b)
        rates_ab = pressure_rates(cylinder, position, speed, pressures, (0.0, 0.0))
        return [speed, piston_force(cylinder, position, speed, pressures) / MASS, *rates_ab]

    time = np.arange(0.0, 0.2, 1e-5)
    start = [place, 1e-3, 140e5, 140e5]
    swing = solve_ivp(rates, (0, 0.2), start, t_eval=time, rtol=1e-9, atol=1e-9, method="DOP853").y[0] - place
    peaks = time[find_peaks(swing)[0]]
    # One spring of oil on either side; at mid stroke sqrt(2 beta A^2 / (V m)).
    stiffness = sum(cylinder.bulk_modulus * cylinder.area**2 / volume for volume in volumes)
    assert 1.0 / np.mean(np.diff(peaks)) == pytest.approx(np.sqrt(stiffness / MASS) / (2 * np.pi), rel=1e-4)
    # Without leakage and friction nothing is lost.
    assert np.abs(swing[-5000:]).max() == pytest.approx(np.abs(swing).max(), rel=1e-4)


def test_seal_friction_is_against_the_motion_and_bounded():
    speeds = np.linspace(-1.0, 1.0, 401)
    friction = np.array([piston_force(CYLINDER, 0.0, v, (1e7, 1e7)) for v in speeds])
    assert np.all(friction * speeds <= 0.0)
    assert np.abs(friction).max() <= CYLINDER.friction
    assert friction[-1] == pytest.approx(-CYLINDER.friction)


class Bench:
    """One actuator on a free mass: piston and load in one, no gravity."""

    def __init__(self, actuator, mass=MASS):
        self.actuator = actuator
        self.mass = mass

    def rates(self, command, state):
        motion = SimpleNamespace(joint_positions=state[:1], joint_velocities=state[1:2])
        effect = Effect([], [0.0], lines={"supply": Line(SUPPLY, BACK)})
        own = self.actuator.apply(motion, state[2:], [command], effect)
        return np.array([state[1], effect.joint_forces[0] / self.mass, *own])

    def play(self, command, seconds, *, points=4001):
        start = np.array([0.0, 0.0, *self.actuator.initial_state])
        time = np.linspace(0.0, seconds, points)
        solved = solve_ivp(
            lambda t, y: self.rates(command(t), y),
            (0, seconds),
            start,
            t_eval=time,
            rtol=1e-9,
            atol=1e-10,
            max_step=1e-3,
        )
        return time, solved.y


def actuator(**changes):
    parts = {"valve": VALVE, "cylinder": CYLINDER, "loop": LOOP} | changes
    place = {"joint_position": 0, "joint_velocity": 0, "supply": "supply", "middle_pressure": (SUPPLY + BACK) / 2}
    return HydraulicActuator(name="one", **place, **parts)


def test_an_actuator_reaches_what_it_is_told_and_holds_it():
    _, states = Bench(actuator()).play(lambda t: 0.02 * min(t / 0.2, 1.0), 1.5)
    assert states[0][-1] == pytest.approx(0.02, abs=1e-4)
    assert abs(states[1][-1]) < 1e-3


def test_no_load_speed_is_what_the_valve_lets_through():
    # A step far away opens the valve fully; without load each edge takes half of the pressure.
    frictionless = dataclasses.replace(CYLINDER, friction=0.0, half_stroke=1.0)
    loop = dataclasses.replace(LOOP, integral=0.0, pressure_feedback=0.0)
    _, states = Bench(actuator(cylinder=frictionless, loop=loop), mass=5.0).play(lambda _: 0.8, 0.3)
    drop = (SUPPLY - BACK) / 2
    expected = VALVE.rated_flow * np.sqrt(drop / VALVE.rated_drop) / CYLINDER.area
    assert states[1][-1] == pytest.approx(expected, rel=5e-3)


def test_while_the_valve_is_at_its_stop_the_integral_waits():
    bench = Bench(actuator())
    state = np.array([0.0, 0.0, *bench.actuator.initial_state])
    assert bench.rates(0.1, state)[-1] == 0.0
    assert bench.rates(0.01, state)[-1] == 0.01


def test_supply_energy_is_work_plus_losses_plus_what_the_oil_stores():
    bench = Bench(actuator())
    time, states = bench.play(lambda t: 0.015 * np.sin(2 * np.pi * 4.0 * t), 0.75, points=15001)
    position, speed, spool, _, a, b, _, _ = states
    a, b = 1e6 * a, 1e6 * b
    power = {"supply": [], "valve": [], "leak": [], "seal": [], "oil": []}
    for x, v, s, pa, pb in zip(position, speed, spool, a, b, strict=True):
        qa, qb, _ = port_flows(VALVE, s, (pa, pb), SUPPLY, BACK)
        # Oil drawn from the supply at its pressure, given to the return at its own.
        drawn, returned = (qa, qb) if s >= 0 else (-qb, -qa)
        power["supply"].append(SUPPLY * drawn - BACK * returned)
        power["valve"].append(((SUPPLY if s >= 0 else BACK) - pa) * qa + (pb - (BACK if s >= 0 else SUPPLY)) * qb)
        power["leak"].append(CYLINDER.leakage * (pa - pb) ** 2)
        power["seal"].append(-v * piston_force(CYLINDER, 0.0, v, (1e7, 1e7)))
        rates = pressure_rates(CYLINDER, x, v, (pa, pb), (qa, qb))
        volumes = [CYLINDER.dead_volume + CYLINDER.area * (CYLINDER.half_stroke + sign * x) for sign in (1, -1)]
        stored = sum(
            p * r * volume / CYLINDER.bulk_modulus for p, r, volume in zip((pa, pb), rates, volumes, strict=True)
        )
        power["oil"].append(stored)
    energy = {name: np.trapezoid(values, time) for name, values in power.items()}
    kinetic = 0.5 * MASS * (speed[-1] ** 2 - speed[0] ** 2)
    assert min(power["valve"]) >= 0.0
    assert min(power["leak"]) >= 0.0
    assert min(power["seal"]) >= 0.0
    spent = energy["valve"] + energy["leak"] + energy["seal"] + energy["oil"] + kinetic
    assert energy["supply"] > 100.0
    assert spent == pytest.approx(energy["supply"], rel=1e-4)


def test_a_supply_below_its_return_is_refused():
    with pytest.raises(ValueError, match="supply_pressure is 100000 Pa; it must be above return_pressure, 500000 Pa"):
        Supply(1e5, 5e5)
