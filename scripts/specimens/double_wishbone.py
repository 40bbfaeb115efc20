"""Write the SDF of a double-wishbone front axle from its hard points.

`python scripts/specimens/double_wishbone.py` writes the shipped ones again: `front_axle` with its body held and six
actuators at the wheels, the same axle with two more for braking, and `predecessor`, an earlier vehicle of other
geometry whose body is free to heave and roll. A user's specimen can be any SDF.

The lower arm floats in two anisotropic bushings, so that the wheel recedes under longitudinal load. The upper arm turns
on a hinge and meets the knuckle in a bushing that carries the compliance of the upper mounts. The tie rod is a stiff
two-force link, held by the body or by a steering rack.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as Xml

import numpy as np
from axles import DOUBLE_WISHBONES, Axle, Rack
from bench import add_actuator, add_body, add_wheel, mirror_of
from numpy.typing import NDArray
from sdf_writing import (
    add_bushing,
    add_frame,
    add_joint,
    add_link,
    add_rod,
    draw_cylinder,
    new_sdf,
    point_masses_inertia,
    sdf_text,
    write_shipped,
)

Points = Mapping[str, NDArray[np.float64]]
"""Hard points of one side by name, in m."""


def add_side(model: Xml.Element, axle: Axle, side: str) -> None:
    """Add arms, knuckle, tie rod and wheel of one side, "left" or "right", and the actuators at it."""
    mirror = mirror_of(side)
    place = np.array([-axle.behind, 0.0, 0.0])
    point = {name: np.array(value) * mirror + place for name, value in vars(axle.points).items()}
    side = axle.prefix + side
    _add_lower_arm(model, axle, side, point)
    hinge = _add_upper_arm(model, axle, side, point)
    _add_knuckle(model, axle, side, point, mirror=mirror, hinge=hinge)
    _add_tie_rod(model, axle, side, point)
    wheel = point["wheel_centre"]
    tyre_radius = None if axle.actuators else float(wheel[2])
    add_wheel(model, side, centre=wheel, mass=axle.masses.wheel, tyre_radius=tyre_radius)
    for mount in axle.actuators:
        add_actuator(model, side, mount, wheel_centre=axle.points.wheel_centre, stiffnesses=axle.stiffnesses)


def _add_lower_arm(model: Xml.Element, axle: Axle, side: str, point: Points) -> None:
    """Add the lower arm in its two bushings."""
    mass, stiff, lower = axle.masses.lower_arm, axle.stiffnesses, point["lower_ball"]
    turning = (stiff.rotation, stiff.rotation_damping)
    centre, inertia = point_masses_inertia([lower, point["lower_front_bushing"], point["lower_rear_bushing"]], mass)
    link = add_link(model, f"{side}_lower_arm", origin=lower, centre=centre, mass=mass, inertia=inertia)
    for end in ("front", "rear"):
        mount = point[f"lower_{end}_bushing"]
        draw_cylinder(link, f"{side}_lower_arm_{end}_tube", np.zeros(3), mount - lower, 0.018)
        frame_a = add_frame(model, f"{side}_lower_{end}_mount", "body", mount)
        frame_c = add_frame(model, f"{side}_lower_{end}_eye", f"{side}_lower_arm", mount - lower)
        along = stiff.lower_front if end == "front" else stiff.lower_rear
        add_bushing(model, frame_a, frame_c, along=along, loss_time=stiff.loss_time, turning=turning)


def _add_upper_arm(model: Xml.Element, axle: Axle, side: str, point: Points) -> NDArray[np.float64]:
    """Add the upper arm on its hinge; return the hinge's middle."""
    mass, upper = axle.masses.upper_arm, point["upper_ball"]
    hinge_front, hinge_rear = point["upper_front_hinge"], point["upper_rear_hinge"]
    centre, inertia = point_masses_inertia([upper, hinge_front, hinge_rear], mass)
    hinge = (hinge_front + hinge_rear) / 2
    link = add_link(model, f"{side}_upper_arm", origin=hinge, centre=centre, mass=mass, inertia=inertia)
    for end, mount in (("front", hinge_front), ("rear", hinge_rear)):
        draw_cylinder(link, f"{side}_upper_arm_{end}_tube", upper - hinge, mount - hinge, 0.014)
    axis = hinge_front - hinge_rear
    add_joint(model, f"{side}_upper_hinge", "revolute", parent="body", child=f"{side}_upper_arm", axis=axis)
    return hinge


def _add_knuckle(
    model: Xml.Element,
    axle: Axle,
    side: str,
    point: Points,
    *,
    mirror: NDArray[np.float64],
    hinge: NDArray[np.float64],
) -> None:
    """Add the knuckle: on the lower arm's ball, in the upper arm's bushing."""
    mass, stiff = axle.masses.knuckle, axle.stiffnesses
    lower, upper, wheel = point["lower_ball"], point["upper_ball"], point["wheel_centre"]
    inertia = np.diag([0.30, 0.24, 0.18]) * mass / 18.0
    centre = wheel + np.array([0.0, -0.05, 0.01]) * mirror
    link = add_link(model, f"{side}_knuckle", origin=wheel, centre=centre, mass=mass, inertia=inertia)
    for name, end in (("lower", lower), ("upper", upper), ("steer", point["tie_rod_outer"])):
        draw_cylinder(link, f"{side}_knuckle_{name}", np.zeros(3), end - wheel, 0.02)
    arm, knuckle = f"{side}_lower_arm", f"{side}_knuckle"
    add_joint(model, f"{side}_lower_ball", "ball", parent=arm, child=knuckle, offset=lower - wheel)
    frame_a = add_frame(model, f"{side}_upper_ball_arm", f"{side}_upper_arm", upper - hinge)
    frame_c = add_frame(model, f"{side}_upper_ball_knuckle", knuckle, upper - wheel)
    add_bushing(model, frame_a, frame_c, along=stiff.upper_ball, loss_time=stiff.ball_loss_time)


def _add_tie_rod(model: Xml.Element, axle: Axle, side: str, point: Points) -> None:
    """Add the tie rod, from the body or the rack to the knuckle."""
    inner, outer = point["tie_rod_inner"], point["tie_rod_outer"]
    length = float(np.linalg.norm(outer - inner))
    law = (axle.stiffnesses.tie_rod, axle.stiffnesses.tie_rod_damping)
    inner_end = ("body", inner) if axle.rack is None else ("rack", inner * np.array([0.0, 1.0, 0.0]))
    add_rod(model, inner_end, (f"{side}_knuckle", outer - point["wheel_centre"]), length=length, law=law)


def _rack(model: Xml.Element, axle: Axle, rack: Rack) -> None:
    """Add the steering rack: it slides across the body against the held pinion's stiffness."""
    inner = np.array(axle.points.tie_rod_inner)
    centre = inner * np.array([1.0, 0.0, 1.0])
    half_length = inner * np.array([0.0, 1.0, 0.0])
    inertia = np.diag([half_length[1] ** 2 / 3, 1.0e-3, half_length[1] ** 2 / 3]) * rack.mass
    link = add_link(model, "rack", origin=centre, centre=centre, mass=rack.mass, inertia=inertia)
    draw_cylinder(link, "rack_bar", -half_length, half_length, 0.014)
    add_joint(model, "rack_stroke", "prismatic", parent="body", child="rack", axis=np.array([0.0, 1.0, 0.0]))
    frame_a = add_frame(model, "rack_housing", "body", centre)
    frame_c = add_frame(model, "rack_centre", "rack", np.zeros(3))
    along = (0.0, rack.stiffness, 0.0)
    add_bushing(model, frame_a, frame_c, along=along, loss_time=rack.damping / rack.stiffness)


def write_sdf(axle: Axle) -> str:
    """Return the SDF of an axle as text, ending in a newline."""
    root, model = new_sdf(axle.name)
    masses = axle.masses
    add_body(model, mass=masses.body, roll_inertia=masses.body_roll_inertia, held=axle.body_held)
    if axle.rack is not None:
        _rack(model, axle, axle.rack)
    for side in ("left", "right"):
        add_side(model, axle, side)
    return sdf_text(root, "double_wishbone")


def main() -> None:
    """Write the shipped SDFs over the old ones."""
    for axle in DOUBLE_WISHBONES:
        write_shipped(axle.name, write_sdf(axle))


if __name__ == "__main__":
    main()
