"""Random nonlinear suspension rigs, all played at once: friction, progressive bushings, valves that saturate, noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

import duralab_roads

SAMPLE_RATE: Final = 256.0
SUBSTEPS: Final = 6
CHANNELS: Final = 6
#: Left vertical, lateral, longitudinal, then right. Typical of the spindle of a passenger car.
REFERENCE_DEFLECTION: Final = np.tile([5e-3, 1.0e-3, 1.5e-3], 2)
_MASS: Final = np.tile([45.0, 45.0, 45.0], 2)
_SUSPENSION: Final = np.tile([3.0e4, 3.0e5, 1.5e5], 2)
_INTERFACE: Final = np.tile([2.5e5, 6.0e5, 5.0e5], 2)
_DAMPING_RATIO: Final = np.tile([0.6, 0.18, 0.18], 2)
#: Of plants driven by force: damping, and how much more their springs stiffen than those of rigs driven by strokes; one
#: way, with the deflection, and both ways, with its square.
_FORCED_DAMPING_RATIO: Final = 0.15
_STIFFENING_ONE_WAY: Final = 50.0
_STIFFENING_BOTH_WAYS: Final = 27.0
#: Speed of the road vehicle, m/s.
_SPEED: Final = 15.0
#: Vertical channel of the wheel of each channel.
_OWN_VERTICAL: Final = np.array([0, 0, 0, 3, 3, 3])
#: Largest arc over the reference deflection where the vertical deflection is that of reference.
_LARGEST_ARC: Final = np.tile([0.0, 1.0, 0.3], 2)


@dataclass(frozen=True)
class Plants:
    """Rigs side by side; every array has the shape (channels, plants), `coupling` (plants, channels, channels).

    A drive moves an actuator that follows with a lag and no faster than its valve allows. A linear interface (tyre or
    adapter), whose force is the response, moves a mass that a suspension holds: progressive stiffness, damping,
    friction that first yields elastically and then slides (Dahl), and stiffness shared between the channels. `arc` in
    1/m: the square of a vertical stroke, times `arc`, displaces a wheel on arms in the other directions.
    """

    mass: NDArray[np.float64]
    interface_stiffness: NDArray[np.float64]
    interface_damping: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    progression: NDArray[np.float64]
    damping: NDArray[np.float64]
    friction_force: NDArray[np.float64]
    friction_stiffness: NDArray[np.float64]
    coupling: NDArray[np.float64]
    actuator_rate: NDArray[np.float64]
    valve_speed: NDArray[np.float64]
    arc: NDArray[np.float64] | None = None


def draw_plants(count: int, *, rng: np.random.Generator) -> Plants:
    """Draw rigs around a front axle; valves are not limited yet."""
    shape = (CHANNELS, count)

    def around(value: NDArray[np.float64], spread: float) -> NDArray[np.float64]:
        return value[:, None] * np.exp(spread * rng.standard_normal(shape))

    mass, stiffness, interface = around(_MASS, 0.2), around(_SUSPENSION, 0.3), around(_INTERFACE, 0.2)
    damping = 2.0 * around(_DAMPING_RATIO, 0.3) * np.sqrt(mass * stiffness)
    share = rng.uniform(-0.25, 0.25, (count, CHANNELS, CHANNELS))
    root = np.sqrt(stiffness.T)
    coupling = (share + share.transpose(0, 2, 1)) / 2.0 * root[:, :, None] * root[:, None, :]
    coupling[:, range(CHANNELS), range(CHANNELS)] = 0.0
    return Plants(
        mass=mass,
        interface_stiffness=interface,
        interface_damping=0.02 * np.sqrt(mass * interface),
        stiffness=stiffness,
        progression=rng.uniform(0.001, 0.005, shape) / REFERENCE_DEFLECTION[:, None] ** 2,
        damping=damping,
        friction_force=rng.uniform(0.05, 0.2, shape) * stiffness * REFERENCE_DEFLECTION[:, None],
        friction_stiffness=rng.uniform(1.0, 3.0, shape) * stiffness,
        coupling=coupling,
        actuator_rate=2.0 * np.pi * rng.uniform(15.0, 40.0, shape),
        valve_speed=np.full(shape, np.inf),
    )


def on_arms(plants: Plants, *, rng: np.random.Generator) -> Plants:
    """Return the rigs with wheels on arcs: arcs of up to one lateral deflection, and a third of a longitudinal one."""
    shape = plants.mass.shape
    share = rng.uniform(0.3, 1.0, shape) * rng.choice([-1.0, 1.0], shape)
    vertical = REFERENCE_DEFLECTION[_OWN_VERTICAL]
    return replace(plants, arc=share * (_LARGEST_ARC * REFERENCE_DEFLECTION / vertical**2)[:, None])


def another_vehicle(plants: Plants, *, rng: np.random.Generator) -> Plants:
    """Return the predecessors: every parameter some 25 % off, wheels that follow the road at once."""

    def changed(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return values * np.exp(0.25 * rng.standard_normal(values.shape))

    return replace(
        plants,
        mass=changed(plants.mass),
        stiffness=changed(plants.stiffness),
        progression=changed(plants.progression),
        damping=changed(plants.damping),
        friction_force=changed(plants.friction_force),
        friction_stiffness=changed(plants.friction_stiffness),
        actuator_rate=np.full_like(plants.actuator_rate, np.inf),
        valve_speed=np.full_like(plants.valve_speed, np.inf),
    )


def play(plants: Plants, drive: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the forces, shape (plants, channels, samples), of drives of the same shape, from rest.

    Semi-implicit Euler, six steps a sample, drives interpolated in between.
    """
    samples = drive.shape[2]
    step = 1.0 / (SAMPLE_RATE * SUBSTEPS)
    wanted = np.ascontiguousarray(drive.transpose(2, 1, 0))
    forces = np.empty((samples, CHANNELS, drive.shape[0]))
    position, speed, friction, actuator = (np.zeros(wanted.shape[1:]) for _ in range(4))
    direct = bool(np.all(np.isinf(plants.actuator_rate)))
    before, force = np.zeros_like(position), np.zeros_like(position)
    for sample in range(samples):
        increment = (wanted[sample] - before) / SUBSTEPS
        command = before
        for _ in range(SUBSTEPS):
            command = command + increment
            if direct:
                actuator_speed = (command - actuator) / step
                actuator = command
            else:
                actuator_speed = np.clip(
                    plants.actuator_rate * (command - actuator), -plants.valve_speed, plants.valve_speed
                )
                actuator = actuator + step * actuator_speed
            end, end_speed = actuator, actuator_speed
            if plants.arc is not None:
                vertical = actuator[_OWN_VERTICAL]
                end = actuator + plants.arc * vertical**2
                end_speed = actuator_speed + 2.0 * plants.arc * vertical * actuator_speed[_OWN_VERTICAL]
            force = plants.interface_stiffness * (end - position)
            force += plants.interface_damping * (end_speed - speed)
            held = plants.stiffness * position * (1.0 + plants.progression * position**2)
            held += plants.damping * speed + friction
            held += np.matmul(plants.coupling, position.T[:, :, None])[:, :, 0].T
            speed = speed + step * (force - held) / plants.mass
            position = position + step * speed
            # Dahl's law, implicit in the friction: stable however soon it slides.
            slip = step * plants.friction_stiffness * speed
            friction = (friction + slip) / (1.0 + np.abs(slip) / plants.friction_force)
        forces[sample] = force
        before = wanted[sample]
    return np.ascontiguousarray(forces.transpose(2, 1, 0))


def play_forces(plants: Plants, drive: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the accelerations, shape (plants, channels, samples), of masses on springs that forces drive, from rest.

    A drive of shape (plants, channels, samples) is the force over the spring's stiffness, m. There is no friction and
    no valve; springs stiffen one way and, less, both ways, so that the response is no polynomial of the drive.
    """
    step = 1.0 / (SAMPLE_RATE * SUBSTEPS)
    wanted = np.ascontiguousarray(drive.transpose(2, 1, 0))
    accelerations = np.empty_like(wanted)
    position, speed, before = (np.zeros(wanted.shape[1:]) for _ in range(3))
    damping = 2.0 * _FORCED_DAMPING_RATIO * np.sqrt(plants.mass * plants.stiffness)
    deflection = REFERENCE_DEFLECTION[:, None]
    progression = plants.progression * deflection**2
    for sample in range(wanted.shape[0]):
        increment, command = (wanted[sample] - before) / SUBSTEPS, before
        for _ in range(SUBSTEPS):
            command = command + increment
            ratio = position / deflection
            stiffening = progression * ratio * (_STIFFENING_ONE_WAY + _STIFFENING_BOTH_WAYS * ratio)
            held = plants.stiffness * position * (1.0 + stiffening) + damping * speed
            held += np.matmul(plants.coupling, position.T[:, :, None])[:, :, 0].T
            acceleration = (plants.stiffness * command - held) / plants.mass
            speed = speed + step * acceleration
            position = position + step * speed
            accelerations[sample] = acceleration
        before = wanted[sample]
    return np.ascontiguousarray(accelerations.transpose(2, 1, 0))


def road_motion(*, samples: int, seed: int) -> NDArray[np.float64]:
    """Motion of both wheels, shape (channels, samples), m: an ISO 8608 road of class C/D with potholes.

    Up and down by the height, sideways by the camber, lengthways by the slope; not yet scaled to metres.
    """
    seconds = samples / SAMPLE_RATE
    road = duralab_roads.iso8608_road(road_class="C/D", length_m=_SPEED * seconds + 40.0, seed=seed)
    road = duralab_roads.add_potholes(road, count=5, seed=seed, lead_in_m=30.0)
    left_right = duralab_roads.effective_inputs(
        road,
        speed=_SPEED,
        sample_rate=SAMPLE_RATE,
        samples=samples,
        track_width=1.5,
        tyre_radius=0.32,
        contact_length=0.12,
        contact_width=0.2,
        lead_in_seconds=1.0,
    )
    return left_right[[0, 2, 1, 3, 5, 4]]
