"""Force control and feed-forward on a bench, and what a specimen may say of its actuators."""

import dataclasses

import numpy as np
import pytest
from actuator_bench import Bench
from pydantic import TypeAdapter, ValidationError

from rig_sim.hydraulics.actuator import HydraulicActuator
from rig_sim.hydraulics.cylinder import Cylinder
from rig_sim.hydraulics.loops import DisplacementLoop, Feedback, ForceLoop
from rig_sim.hydraulics.mounting import (
    ActuatorKind,
    ActuatorPart,
    ForceKind,
    all_supplies,
    check_limits,
    mount_actuator,
)
from rig_sim.hydraulics.servovalve import Servovalve
from rig_sim.hydraulics.supply import HydraulicSupply, Supply

SUPPLY = Supply(280e5, 5e5)
VALVE = Servovalve(rated_flow=1.05e-3, rated_drop=35e5, spool_frequency=180.0, spool_damping=0.8)
CYLINDER = Cylinder(
    area=1e-3,
    half_stroke=0.1,
    dead_volume=3e-5,
    bulk_modulus=1.2e9,
    leakage=3e-11,
    friction=0.0,
    friction_speed=0.01,
)
LOOP = ForceLoop(
    proportional=1.5e-5, integral=1e-3, pressure_feedback=0.0, pressure_corner=5.0, feedback=Feedback.PRESSURE
)
PLACE = {"name": "one", "joint_position": 0, "joint_velocity": 0, "supply": "supply", "middle_pressure": 142.5e5}


def force_bench(loop=LOOP, **body):
    actuator = HydraulicActuator(valve=VALVE, cylinder=CYLINDER, loop=loop, **PLACE)
    return Bench(actuator, HydraulicSupply("supply", SUPPLY), **({"mass": 20.0, "stiffness": 2e7} | body))


def test_a_step_of_force_is_reached_within_milliseconds_and_held_exactly():
    bench = force_bench(damping=4e3)
    time, states = bench.play(lambda t: 2000.0 if t > 0.01 else 0.0, 1.0, points=2001)
    force = bench.monitored(lambda _: 2000.0, time, states)["one.force"]
    rise = time[np.argmax(force > 0.9 * 2000.0)] - 0.01
    assert 0.0 < rise < 0.05
    assert force.max() < 1.2 * 2000.0
    assert force[-1] == pytest.approx(2000.0, rel=1e-3)
    # Held by the specimen's spring: the wall feels what the loop says.
    assert 2e7 * states[0][-1] == pytest.approx(2000.0, rel=1e-3)


def test_the_first_rise_is_as_fast_as_valve_and_oil_allow():
    # Stiff wall: dF/dt = Kq u / (V / (2 beta A) + A / k) with u = P e; an exponential with that rate.
    loop = dataclasses.replace(LOOP, integral=0.0, proportional=4e-6)
    valve = dataclasses.replace(VALVE, spool_frequency=3000.0, spool_damping=1.0)
    cylinder = dataclasses.replace(CYLINDER, leakage=0.0)
    actuator = HydraulicActuator(valve=valve, cylinder=cylinder, loop=loop, **PLACE)
    bench = Bench(actuator, HydraulicSupply("supply", SUPPLY), mass=0.2, stiffness=5e7, damping=2e3)
    time, states = bench.play(lambda _: 500.0, 0.03, points=301)
    force = bench.monitored(lambda _: 500.0, time, states)["one.force"]
    gain = VALVE.rated_flow * np.sqrt(137.5 / 35.0)
    volume = 3e-5 + 1e-3 * 0.1
    rate = 4e-6 * gain / (volume / (2 * 1.2e9 * 1e-3) + 1e-3 / 5e7)
    np.testing.assert_allclose(force[100:], 500.0 * (1 - np.exp(-rate * time[100:])), rtol=0.02)


@pytest.mark.parametrize("share", [0.0, 0.9])
def test_velocity_compensation_gives_the_oil_that_a_moving_specimen_takes(share):
    # Against a damper c the piston keeps moving, at F / c: P (F_wanted - F) has to give what compensation does not.
    full = CYLINDER.area / (VALVE.rated_flow * np.sqrt(137.5 / 35.0))
    loop = dataclasses.replace(LOOP, velocity_compensation=share * full, integral=0.0)
    cylinder = dataclasses.replace(CYLINDER, leakage=0.0)
    actuator = HydraulicActuator(valve=VALVE, cylinder=cylinder, loop=loop, **PLACE)
    bench = Bench(actuator, HydraulicSupply("supply", SUPPLY), mass=50.0, damping=2e4)
    time, states = bench.play(lambda t: 400.0 * min(t / 0.05, 1.0), 0.5, points=201)
    force = bench.monitored(lambda _: 400.0, time, states)["one.force"][-1]
    gain = 2e4 * LOOP.proportional / (full * (1.0 - share))
    assert force == pytest.approx(400.0 * gain / (1.0 + gain), rel=0.03)


def test_feed_forward_of_its_velocity_makes_the_stroke_follow_a_ramp():
    cylinder = dataclasses.replace(CYLINDER, leakage=0.0)
    gain = VALVE.rated_flow * np.sqrt(137.5 / 35.0)

    def lag(feedforward):
        loop = DisplacementLoop(
            proportional=20.0,
            integral=0.0,
            pressure_feedback=1e-8,
            pressure_corner=20.0,
            velocity_feedforward=feedforward,
        )
        actuator = HydraulicActuator(valve=VALVE, cylinder=cylinder, loop=loop, **PLACE)
        bench = Bench(actuator, HydraulicSupply("supply", SUPPLY), mass=20.0)
        time, states = bench.play(lambda t: 0.1 * t, 0.4, points=401)
        return 0.1 * time[-1] - states[0][-1]

    # Without it the error makes the valve open: v A / (Kq P).
    assert lag(0.0) == pytest.approx(0.1 * 1e-3 / gain / 20.0, rel=0.02)
    assert abs(lag(1e-3 / gain)) < 0.03 * lag(0.0)


DOCUMENT = {
    "control": "force",
    "valve": {"rated_flow": 1e-3, "rated_drop": 35e5, "spool_frequency": 180.0, "spool_damping": 0.8},
    "cylinder": {
        "area": 1e-3,
        "half_stroke": 0.1,
        "dead_volume": 3e-5,
        "bulk_modulus": 1.2e9,
        "leakage": 3e-11,
        "friction": 60.0,
        "friction_speed": 0.01,
    },
    "loop": {"proportional": 1e-5, "integral": 1e-3, "pressure_feedback": 0.0, "pressure_corner": 5.0},
}


def test_the_control_of_a_kind_decides_what_its_loop_says():
    kinds = TypeAdapter(ActuatorKind)
    assert isinstance(kinds.validate_python(DOCUMENT), ForceKind)
    with pytest.raises(ValidationError, match="control must be 'displacement' or 'force'"):
        kinds.validate_python(DOCUMENT | {"control": "speed"})
    with pytest.raises(ValidationError, match="velocity_feedforward"):
        kinds.validate_python(DOCUMENT | {"loop": DOCUMENT["loop"] | {"velocity_feedforward": 0.1}})


def test_what_an_actuator_cannot_be_is_said(front_axle):
    tree = front_axle.model.assembly.tree
    kinds = {"force": TypeAdapter(ActuatorKind).validate_python(DOCUMENT)}
    part = ActuatorPart(name="one", kind="force", joint="left_lateral_stroke")
    mounted = mount_actuator(part, kinds, {"supply": SUPPLY}, tree)
    assert mounted.inputs[0].unit == "N"
    with pytest.raises(ValueError, match="pulls with -27500 N and pushes with 27500 N at most"):
        check_limits(mounted, SUPPLY, minimum=-1000.0, maximum=3e4)
    with pytest.raises(ValueError, match="fed by supply 'left'; there are supply"):
        mount_actuator(part.model_copy(update={"supply": "left"}), kinds, {"supply": SUPPLY}, tree)
    bare = dataclasses.replace(tree, springs=())
    with pytest.raises(ValueError, match=r"but 0 rods .* hold its piston 'left_lateral_piston'; it takes exactly one"):
        mount_actuator(part, kinds, {"supply": SUPPLY}, bare)
    with pytest.raises(ValueError, match="names must differ"):
        all_supplies(SUPPLY, {"supply": SUPPLY})


def test_acceleration_compensation_takes_a_load_cell():
    with pytest.raises(ValueError, match="with feedback: pressure it must be 0"):
        dataclasses.replace(LOOP, acceleration_compensation=1e-3)
