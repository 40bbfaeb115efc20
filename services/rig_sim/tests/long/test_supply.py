"""A supply that sags: its accumulator against the polytropic law, its pump and relief valve, and the energy."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from actuator_bench import Bench
from scipy.integrate import solve_ivp

from rig_sim.hydraulics.actuator import HydraulicActuator
from rig_sim.hydraulics.cylinder import Cushion, Cylinder, cushion_force, seal_friction
from rig_sim.hydraulics.loops import DisplacementLoop
from rig_sim.hydraulics.servovalve import Servovalve, edge_opening, signed_root
from rig_sim.hydraulics.supply import Accumulator, HydraulicSupply, PowerUnit, Supply
from rig_sim.multibody.forces import Effect

BACK = 5e5
GAS = Accumulator(gas_volume=0.01, precharge=180e5, polytropic_exponent=1.25)
UNIT = PowerUnit(
    pump_flow=2.0e-3,
    compensator_band=10e5,
    pump_time=0.08,
    drain=1.0e-13,
    relief_pressure=310e5,
    relief_slope=1.0e-9,
    accumulator=GAS,
    line_volume=4e-3,
    bulk_modulus=1.2e9,
)
LAW = Supply(supply_pressure=280e5, return_pressure=BACK, unit=UNIT)
PUMPLESS = dataclasses.replace(UNIT, pump_flow=1e-12, drain=1e-20, line_volume=1e-9)


def draw(law, flow, seconds, *, start):
    """Return pressures (samples,) in Pa after a constant flow was drawn for these seconds (samples,)."""
    supply = HydraulicSupply("supply", law)

    def rates(_, state):
        effect = Effect([], [])
        supply.offer(state, effect)
        effect.lines["supply"].drawn = flow
        return supply.apply(SimpleNamespace(), state, np.array([]), effect)

    initial = [math.log(start / law.unit.accumulator.precharge), 0.0]
    solved = solve_ivp(rates, (0.0, seconds[-1]), initial, t_eval=seconds, rtol=1e-10, atol=1e-12, method="LSODA")
    return law.unit.accumulator.precharge * np.exp(solved.y[0])


@pytest.mark.parametrize("exponent", [1.0, 1.25, 1.4])
def test_an_accumulator_alone_sags_as_the_polytropic_law_says(exponent):
    gas = dataclasses.replace(GAS, polytropic_exponent=exponent)
    law = dataclasses.replace(LAW, unit=dataclasses.replace(PUMPLESS, accumulator=gas))
    time = np.linspace(0.0, 1.0, 11)
    pressure = draw(law, 2.0e-3, time, start=270e5)
    full = gas.gas_volume * (gas.precharge / 270e5) ** (1 / exponent)
    np.testing.assert_allclose(pressure, 270e5 * (full / (full + 2.0e-3 * time)) ** exponent, rtol=1e-6)


def test_an_empty_accumulator_leaves_the_line_only():
    law = dataclasses.replace(LAW, unit=dataclasses.replace(PUMPLESS, line_volume=4e-3))
    pressure = draw(law, 1.0e-5, np.array([0.0, 0.1]), start=150e5)
    assert pressure[0] - pressure[1] == pytest.approx(1.0e-6 * 1.2e9 / 4e-3, rel=1e-6)


def test_a_pump_that_gives_what_is_drawn_holds_its_place_in_the_compensators_band():
    pressure = draw(LAW, 1.2e-3, np.array([0.0, 5.0, 10.0]), start=279e5)
    drain = UNIT.drain * (pressure[-1] - BACK)
    assert pressure[-1] == pytest.approx(280e5 - (1.2e-3 + drain) / 2.0e-3 * 10e5, rel=1e-6)


def test_the_relief_valve_holds_what_is_pressed_back():
    pressure = draw(LAW, -1.0e-3, np.array([0.0, 3.0]), start=280e5)[-1]
    assert pressure == pytest.approx(310e5 + (1.0e-3 - UNIT.drain * pressure) / 1.0e-9, rel=1e-4)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"accumulator": dataclasses.replace(GAS, precharge=290e5)}, "precharge is 2.9e.07 Pa; it must be between"),
        ({"relief_pressure": 270e5}, "relief_pressure is 2.7e.07 Pa; it must be above supply_pressure"),
    ],
)
def test_a_power_unit_that_cannot_hold_its_pressure_is_refused(change, said):
    with pytest.raises(ValueError, match=said):
        dataclasses.replace(LAW, unit=dataclasses.replace(UNIT, **change))


VALVE = Servovalve(
    rated_flow=2.5e-3,
    rated_drop=35e5,
    spool_frequency=110.0,
    spool_damping=0.8,
    overlap=-0.01,
    rounding=0.004,
    port_b_gain=0.7,
    pilot_frequency=250.0,
)
CYLINDER = Cylinder(
    area=2e-3,
    rod_side_area=1.4e-3,
    half_stroke=0.03,
    dead_volume=5e-5,
    bulk_modulus=1.2e9,
    leakage=1e-11,
    friction=120.0,
    friction_speed=0.01,
    stiction=80.0,
    stribeck_speed=0.05,
    viscous_friction=200.0,
    cushion=Cushion(length=0.006, stiffness=2e6, damping=2e4),
)
LOOP = DisplacementLoop(
    proportional=40.0,
    integral=50.0,
    pressure_feedback=1e-8,
    pressure_corner=20.0,
    derivative=0.05,
    velocity_feedforward=0.2,
    acceleration_feedforward=1e-4,
)


def large_motion():
    """Play an actuator that draws more than its pump gives, into its cushions."""
    actuator = HydraulicActuator(
        name="one",
        joint_position=0,
        joint_velocity=0,
        valve=VALVE,
        cylinder=CYLINDER,
        loop=LOOP,
        supply="supply",
        middle_pressure=140e5,
    )
    unit = dataclasses.replace(UNIT, pump_flow=5e-4, accumulator=dataclasses.replace(GAS, gas_volume=1e-3))
    supply = HydraulicSupply("supply", dataclasses.replace(LAW, unit=unit))
    bench = Bench(actuator, mass=60.0, stiffness=2e5, damping=500.0, supply=supply)
    time, states = bench.play(lambda t: 0.029 * np.sin(2 * np.pi * 5.0 * t), 0.5, points=20001)
    return bench, time, states


def test_energy_of_pump_and_gas_is_work_plus_every_loss_plus_what_is_stored():
    bench, time, states = large_motion()
    x, v, spool = states[0], states[1], states[2]
    a, b = 1e6 * states[5], 1e6 * states[6]
    unit, gas = bench.supply.law.unit, bench.supply.law.unit.accumulator
    p = gas.precharge * np.exp(states[11])
    pump = unit.pump_flow * states[12]
    drop = 1 / VALVE.rated_drop

    def edge(travel, gain, difference):
        flow = [
            gain * VALVE.rated_flow * edge_opening(VALVE, s) * signed_root(d * drop)
            for s, d in zip(travel, difference, strict=True)
        ]
        return np.array(flow), np.array(flow) * difference

    supply_a, lost_1 = edge(np.clip(spool, -1, 1), 1.0, p - a)
    a_return, lost_2 = edge(-np.clip(spool, -1, 1), 1.0, a - BACK)
    supply_b, lost_3 = edge(-np.clip(spool, -1, 1), 0.7, p - b)
    b_return, lost_4 = edge(np.clip(spool, -1, 1), 0.7, b - BACK)
    drained = unit.drain * (p - BACK)
    rod_volumes = (5e-5 + 2e-3 * (0.03 + x), 5e-5 + 1.4e-3 * (0.03 - x))
    leak = CYLINDER.leakage * (a - b)
    flow_in = (supply_a - a_return - leak - 2e-3 * v, supply_b - b_return + leak + 1.4e-3 * v)
    cushion = np.array([cushion_force(CYLINDER, *state) for state in zip(x, v, strict=True)])
    power = {
        "put in": p * pump - BACK * (a_return + b_return) - BACK * drained,
        "valve": lost_1 + lost_2 + lost_3 + lost_4,
        "drain": drained * (p - BACK),
        "leak": leak * (a - b),
        "seal": np.array([seal_friction(CYLINDER, speed) for speed in v]) * v,
        "cushion": -cushion * v,
        "wall damper": 500.0 * v**2,
        # The oil in both chambers, and gas and oil of the supply: what flows in, times the pressure it meets.
        "oil": a * flow_in[0] + b * flow_in[1],
        "supply": p * (pump - drained - supply_a - supply_b),
    }
    energy = {name: np.trapezoid(values, time) for name, values in power.items()}
    energy["moving"] = 0.5 * 60.0 * v[-1] ** 2 + 0.5 * 2e5 * x[-1] ** 2
    put_in = energy.pop("put in")
    assert energy["seal"] > 0.0
    assert energy["valve"] > 0.5 * put_in > 100.0
    assert sum(energy.values()) == pytest.approx(put_in, rel=3e-4)
    # The chambers' oil stores what compresses it: p dp V / beta over the same path.
    stored = sum(
        np.trapezoid(pressure * volume / 1.2e9, pressure) for pressure, volume in zip((a, b), rod_volumes, strict=True)
    )
    assert energy["oil"] == pytest.approx(stored, abs=2e-3 * put_in)
    # And gas and line, whatever the path, what lies between both ends.
    ends = np.array([p[0], p[-1]])
    volume = gas.gas_volume * (gas.precharge / ends) ** (1 / 1.25)
    by_gas = np.diff(ends * volume)[0] / (1.25 - 1.0) + np.diff(ends**2)[0] * unit.line_volume / 2.4e9
    assert energy["supply"] == pytest.approx(by_gas, rel=2e-3)


def test_drawing_more_than_the_pump_gives_sags_the_pressure_and_slows_the_piston():
    bench, _, states = large_motion()
    pressure = 180e5 * np.exp(states[11])
    assert pressure.min() < 0.9 * 280e5
    constant = dataclasses.replace(bench, supply=HydraulicSupply("supply", Supply(280e5, BACK)))
    _, free = constant.play(lambda t: 0.029 * np.sin(2 * np.pi * 5.0 * t), 0.5, points=501)
    assert np.abs(free[1]).max() > np.abs(states[1]).max()
