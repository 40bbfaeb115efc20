"""Common parts of axles on a bench: the held body, the wheel behind its force transducer, the pistons."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import numpy as np
from axles import ActuatorMount, Point, Stiffnesses
from sdf_writing import add_joint, add_link, add_rod, draw_cylinder

#: Radius of the disc that replaces the tyre on a rig, in m.
_DISC_RADIUS = 0.16


def mirror_of(side: str) -> np.ndarray:
    """Return the factors that mirror a point of the left side to this side, (3,)."""
    return np.array([1.0, 1.0 if side.endswith("left") else -1.0, 1.0])


def add_body(model: Xml.Element, *, mass: float, roll_inertia: float, held: bool) -> None:
    """Add the body, held in the world or free to heave and roll."""
    height = np.array([0.0, 0.0, 0.55])
    origin = np.zeros(3)
    inertia = np.diag([roll_inertia, 0.4 * roll_inertia, roll_inertia])
    add_link(model, "body", origin=origin, centre=height, mass=mass, inertia=inertia)
    if held:
        add_joint(model, "body_clamp", "fixed", parent="world", child="body")
        return
    # Drake has no joint for heave and roll, so a light carriage between two joints is used.
    add_link(model, "heave_carriage", origin=origin, centre=height, mass=10.0, inertia=np.eye(3))
    add_joint(model, "body_heave", "prismatic", parent="world", child="heave_carriage", axis=np.array([0.0, 0.0, 1.0]))
    add_joint(model, "body_roll", "revolute", parent="heave_carriage", child="body", axis=np.array([1.0, 0.0, 0.0]))


def add_wheel(model: Xml.Element, side: str, *, centre: np.ndarray, mass: float, tyre_radius: float | None) -> None:
    """Add a wheel behind the wheel-force transducer of its knuckle.

    Parameters
    ----------
    model : Element
        Model to extend.
    side : str
        "left" or "right".
    centre : (3,)
        Wheel centre in the model's frame, in m.
    mass : float
        Mass in kg.
    tyre_radius : float or None
        Radius in m; without a tyre the wheel is drawn as a disc.
    """
    inertia = np.diag([0.55, 0.95, 0.55]) * mass / 22.0
    link = add_link(model, f"{side}_wheel", origin=centre, centre=centre, mass=mass, inertia=inertia)
    half_width = np.array([0.0, 0.10, 0.0]) * mirror_of(side)
    draw_cylinder(link, f"{side}_wheel_disc", -half_width, half_width, tyre_radius or _DISC_RADIUS)
    add_joint(model, f"{side}_wheel_force_transducer", "fixed", parent=f"{side}_knuckle", child=f"{side}_wheel")


def add_actuator(
    model: Xml.Element, side: str, mount: ActuatorMount, *, wheel_centre: Point, stiffnesses: Stiffnesses
) -> None:
    """Add the piston of an actuator, its stroke in the world, and the rod that joins it to the wheel."""
    mirror = mirror_of(side)
    offset, rod = np.array(mount.offset) * mirror, np.array(mount.rod) * mirror
    piston_end = np.array(wheel_centre) * mirror + offset + rod
    name = f"{side}_{mount.direction}_piston"
    # A positive stroke moves the wheel along the positive axis of ISO 8855, on both sides.
    axis = np.abs(np.array(mount.rod))
    inertia = np.eye(3) * mount.piston_mass * 0.02**2
    link = add_link(model, name, origin=piston_end, centre=piston_end, mass=mount.piston_mass, inertia=inertia)
    draw_cylinder(link, f"{name}_rod", np.zeros(3), 0.35 * rod, 0.025)
    add_joint(model, f"{side}_{mount.direction}_stroke", "prismatic", parent="world", child=name, axis=axis)
    law = (stiffnesses.actuator_rod, stiffnesses.actuator_rod_damping)
    add_rod(model, (name, np.zeros(3)), (f"{side}_wheel", offset), length=float(np.linalg.norm(rod)), law=law)
