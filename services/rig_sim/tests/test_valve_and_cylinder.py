"""What real valves and cylinders add: lands that overlap, unequal areas, seals that stick, ends that stop."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import find_peaks

from rig_sim.hydraulics.cylinder import (
    Cushion,
    Cylinder,
    cushion_force,
    load_pressure,
    piston_force,
    pressure_rates,
    seal_friction,
)
from rig_sim.hydraulics.servovalve import Servovalve, edge_opening, port_flows, spool_rates

SUPPLY, BACK = 280e5, 5e5
IDEAL = Servovalve(rated_flow=2.0e-3, rated_drop=35e5, spool_frequency=110.0, spool_damping=0.8)
DOUBLE_ROD = Cylinder(
    area=2e-3,
    half_stroke=0.1,
    dead_volume=5e-5,
    bulk_modulus=1.2e9,
    leakage=0.0,
    friction=100.0,
    friction_speed=0.002,
)
SINGLE_ROD = dataclasses.replace(DOUBLE_ROD, rod_side_area=1.3e-3, friction=0.0)


def steady_flow(valve, opening, load_share):
    """Flow into A and out of B of a valve between chambers that share the supply's drop for this load pressure."""
    load = load_share * (SUPPLY - BACK)
    a, b = (SUPPLY + BACK + load) / 2, (SUPPLY + BACK - load) / 2
    return port_flows(valve, opening, (a, b), SUPPLY, BACK)


@pytest.mark.parametrize("opening", [0.3, 1.0, -0.6])
@pytest.mark.parametrize("load", [-0.5, 0.0, 0.6])
def test_the_flow_pressure_curve_is_the_textbooks(opening, load):
    flows = steady_flow(IDEAL, opening, load)
    # Merritt 6-40 for a matched, symmetric valve: q = K x sqrt((p_s - sign(x) p_L) / 2), with p_s above the return.
    drop = (SUPPLY - BACK) * (1.0 - np.sign(opening) * load) / 2
    expected = IDEAL.rated_flow * opening * np.sqrt(drop / IDEAL.rated_drop)
    np.testing.assert_allclose(flows[:2], [expected, expected], rtol=1e-4)
    assert flows.drawn == pytest.approx(abs(expected), rel=1e-4)


@pytest.mark.parametrize("overlap", [0.03, 0.0, -0.03])
def test_lands_open_beyond_their_overlap_and_fully_at_full_stroke(overlap):
    valve = dataclasses.replace(IDEAL, overlap=overlap)
    travel = np.array([-1.0, overlap - 0.01, overlap, overlap + 0.2, 1.0])
    opening = [edge_opening(valve, x) for x in travel]
    np.testing.assert_allclose(opening, [0.0, 0.0, 0.0, 0.2 / (1 - overlap), 1.0], atol=1e-15)


def test_overlap_is_a_dead_zone_and_costs_gain_beside_it_only():
    valve = dataclasses.replace(IDEAL, overlap=0.04)
    assert steady_flow(valve, 0.039, 0.3) == (0.0, 0.0, 0.0)
    for opening in (0.2, 1.0, -0.7):
        inside = np.sign(opening) * (abs(opening) - 0.04) / 0.96
        np.testing.assert_allclose(steady_flow(valve, opening, 0.3), steady_flow(IDEAL, inside, 0.3), rtol=1e-12)


def test_underlap_doubles_the_flow_gain_about_null_and_leaks_through_both_lands():
    valve = dataclasses.replace(IDEAL, overlap=-0.05)
    slope = (steady_flow(valve, 1e-4, 0.0).into_a - steady_flow(valve, -1e-4, 0.0).into_a) / 2e-4
    beyond = (steady_flow(valve, 0.5, 0.0).into_a - steady_flow(valve, 0.4, 0.0).into_a) / 0.1
    assert slope == pytest.approx(2 * beyond, rel=1e-6)
    # At null, unloaded: what goes from the supply to each port goes on to the return.
    quiet = steady_flow(valve, 0.0, 0.0)
    centre = 2 * IDEAL.rated_flow * 0.05 / 1.05 * np.sqrt((SUPPLY - BACK) / 2 / IDEAL.rated_drop)
    assert quiet.into_a == pytest.approx(0.0, abs=1e-15)
    assert quiet.drawn == pytest.approx(centre, rel=1e-4)


def test_rounded_edges_are_smooth_and_sharp_again_a_little_further_on():
    valve = dataclasses.replace(IDEAL, overlap=0.02, rounding=0.005)
    sharp = dataclasses.replace(IDEAL, overlap=0.02)
    travel = np.linspace(-0.1, 0.1, 4001)
    slope = np.gradient([edge_opening(valve, x) for x in travel], travel)
    assert np.abs(np.diff(slope)).max() < 0.01
    assert edge_opening(valve, 0.3) == pytest.approx(edge_opening(sharp, 0.3), abs=5e-5)
    assert edge_opening(valve, 1.0) == 1.0
    assert 0.0 < edge_opening(valve, 0.0) < 1e-3


def test_lands_in_the_ratio_of_the_areas_keep_a_single_rod_balanced():
    valve = dataclasses.replace(IDEAL, port_b_gain=0.65)
    a, b = 0.65 * 200e5, 200e5
    into_a, out_of_b, drawn = port_flows(valve, -0.4, (a, b), SUPPLY, BACK)
    assert into_a == pytest.approx(-0.4 * IDEAL.rated_flow * np.sqrt((a - BACK) / 35e5), rel=1e-4)
    assert out_of_b == pytest.approx(-0.65 * 0.4 * IDEAL.rated_flow * np.sqrt((SUPPLY - b) / 35e5), rel=1e-4)
    assert drawn == -out_of_b


def test_the_pilot_stage_is_a_first_order_lag_before_the_spool():
    valve = dataclasses.replace(IDEAL, pilot_frequency=50.0, spool_frequency=5000.0, spool_damping=1.0)
    solved = solve_ivp(
        lambda _, y: spool_rates(valve, 0.5, y), (0, 0.01), valve.initial_state, method="Radau", rtol=1e-8, atol=1e-10
    )
    expected = 0.5 * (1 - np.exp(-2 * np.pi * 50.0 * (0.01 - 2 / (2 * np.pi * 5000.0))))
    assert solved.y[0, -1] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("place", [0.0, 0.06, -0.05])
def test_the_oil_column_of_a_single_rod_swings_at_the_analytic_frequency(place):
    mass = 80.0
    areas = SINGLE_ROD.areas
    volumes = [5e-5 + areas[0] * (0.1 + place), 5e-5 + areas[1] * (0.1 - place)]

    def rates(_, state):
        position, speed, a, b = state
        force = piston_force(SINGLE_ROD, position, speed, (a, b))
        return [speed, force / mass, *pressure_rates(SINGLE_ROD, position, speed, (a, b), (0.0, 0.0))]

    time = np.arange(0.0, 0.2, 1e-5)
    start = [place, 1e-3, 0.65 * 140e5, 140e5]
    swing = solve_ivp(rates, (0, 0.2), start, t_eval=time, rtol=1e-9, atol=1e-9, method="DOP853").y[0] - place
    stiffness = sum(1.2e9 * area**2 / volume for area, volume in zip(areas, volumes, strict=True))
    period = np.mean(np.diff(time[find_peaks(swing)[0]]))
    assert 1.0 / period == pytest.approx(np.sqrt(stiffness / mass) / (2 * np.pi), rel=2e-4)
    assert load_pressure(SINGLE_ROD, *start[2:]) == pytest.approx(0.0, abs=1e-6)


def test_friction_follows_stribecks_curve():
    cylinder = dataclasses.replace(DOUBLE_ROD, stiction=60.0, stribeck_speed=0.02, viscous_friction=150.0)
    speeds = np.linspace(0.0, 1.0, 100001)
    friction = np.array([seal_friction(cylinder, v) for v in speeds])
    # Breakaway near F_c + F_s, a valley behind it, then viscous.
    breakaway = friction[: np.searchsorted(speeds, 0.02)].max()
    assert 0.93 * 160.0 < breakaway < 160.0
    valley = friction[np.argmax(friction > 0.99 * breakaway) :].min()
    assert valley < 0.72 * breakaway
    assert friction[-1] == pytest.approx(100.0 + 150.0, rel=1e-6)
    assert seal_friction(cylinder, -0.3) == -seal_friction(cylinder, 0.3)
    assert np.all(friction >= 0.0)


def test_a_piston_below_breakaway_only_creeps_and_jumps_above_it():
    cylinder = dataclasses.replace(DOUBLE_ROD, stiction=60.0, stribeck_speed=0.02)

    def speed_after(push):
        def rates(_, v):
            return [(push - seal_friction(cylinder, v[0])) / 20.0]

        return solve_ivp(rates, (0.0, 0.5), [0.0], method="LSODA", rtol=1e-8, atol=1e-12).y[0, -1]

    assert speed_after(140.0) < 2.0 * cylinder.friction_speed
    assert speed_after(170.0) > 1.0


def test_a_stiction_that_fades_before_it_is_there_is_refused():
    with pytest.raises(ValueError, match=r"stribeck_speed is 0.003 m/s; it must be above twice the friction_speed"):
        dataclasses.replace(DOUBLE_ROD, stiction=60.0, stribeck_speed=0.003)


def test_cushions_take_the_pistons_energy_before_the_metal_end():
    cushion = Cushion(length=0.01, stiffness=4.0e6, damping=4.0e4)
    cylinder = dataclasses.replace(DOUBLE_ROD, friction=0.0, cushion=cushion)
    mass, speed = 40.0, 1.5

    def rates(_, state):
        return [state[1], cushion_force(cylinder, state[0], state[1]) / mass]

    time = np.linspace(0.0, 0.06, 20001)
    x, v = solve_ivp(rates, (0, 0.06), [0.08, speed], t_eval=time, rtol=1e-10, atol=1e-12, max_step=1e-5).y
    assert 0.09 < x.max() < 0.1
    assert v[-1] < 0.0
    # What is lost is what the damper took.
    depth = np.maximum(x - 0.09, 0.0)
    push = np.array([-cushion_force(cylinder, *state) for state in zip(x, v, strict=True)])
    damper = np.trapezoid((push - cushion.stiffness * depth) * v, time)
    assert 0.5 * mass * (speed**2 - v[-1] ** 2) == pytest.approx(damper, rel=1e-4)
    assert damper > 0.3 * 0.5 * mass * speed**2
    assert np.all(push >= 0.0)


def test_a_cushion_never_pulls_and_both_ends_are_alike():
    cylinder = dataclasses.replace(DOUBLE_ROD, cushion=Cushion(length=0.01, stiffness=4.0e6, damping=4.0e5))
    assert cushion_force(cylinder, 0.095, -5.0) == 0.0
    assert cushion_force(cylinder, -0.097, -0.2) == -cushion_force(cylinder, 0.097, 0.2)
    assert cushion_force(cylinder, 0.05, 9.0) == 0.0
    with pytest.raises(ValueError, match=r"cushion is 0.2 m long; it must be shorter than half_stroke, 0.1 m"):
        dataclasses.replace(DOUBLE_ROD, cushion=Cushion(length=0.2, stiffness=1.0, damping=0.0))
