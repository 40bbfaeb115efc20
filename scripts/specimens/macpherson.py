"""Write the SDF of a MacPherson front axle from its hard points: `python scripts/specimens/macpherson.py`.

Strut tube, knuckle and spindle are one body. The damper's rod slides in the tube and ends in a rubber top mount on the
body, in which it turns freely. A lower arm in two rubber bushings and a tie rod hold the rest; nothing joins the sides.
"""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import numpy as np
from axles import MACPHERSON, MacPhersonAxle
from bench import add_actuator, add_body, add_wheel, mirror_of
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


def _side(model: Xml.Element, axle: MacPhersonAxle, side: str) -> None:
    mirror = mirror_of(side)
    point = {name: np.array(value) * mirror for name, value in vars(axle.points).items()}
    wheel = point["wheel_centre"]
    _lower_arm(model, axle, side, point)

    knuckle = f"{side}_knuckle"
    link = add_link(
        model,
        knuckle,
        origin=wheel,
        centre=wheel + np.array([-0.005, -0.07, 0.08]) * mirror,
        mass=axle.knuckle_mass,
        inertia=np.diag([0.75, 0.65, 0.25]),
    )
    for name in ("lower_ball", "strut_foot", "tie_rod_outer"):
        draw_cylinder(link, f"{knuckle}_{name}", np.zeros(3), point[name] - wheel, 0.02)
    add_joint(
        model,
        f"{side}_lower_ball",
        "ball",
        parent=f"{side}_lower_arm",
        child=knuckle,
        offset=point["lower_ball"] - wheel,
    )
    _strut_rod(model, axle, side, point)

    inner, outer = point["tie_rod_inner"], point["tie_rod_outer"]
    length = float(np.linalg.norm(outer - inner))
    law = (axle.stiffnesses.tie_rod, axle.stiffnesses.tie_rod_damping)
    add_rod(model, ("body", inner), (knuckle, outer - wheel), length=length, law=law)
    add_wheel(model, side, centre=wheel, mass=axle.wheel_mass, tyre_radius=None)
    for mount in axle.actuators:
        add_actuator(model, side, mount, wheel_centre=axle.points.wheel_centre, stiffnesses=axle.stiffnesses)


def _lower_arm(model: Xml.Element, axle: MacPhersonAxle, side: str, point: dict[str, np.ndarray]) -> None:
    """Add the lower arm: a stiff handling bushing in line with the wheel, a soft ride bushing behind it."""
    stiff, ball, arm = axle.stiffnesses, point["lower_ball"], f"{side}_lower_arm"
    mounts = {end: point[f"lower_{end}_bushing"] for end in ("front", "rear")}
    centre, inertia = point_masses_inertia([ball, *mounts.values()], axle.lower_arm_mass)
    link = add_link(model, arm, origin=ball, centre=centre, mass=axle.lower_arm_mass, inertia=inertia)
    for end, mount in mounts.items():
        draw_cylinder(link, f"{arm}_{end}_tube", np.zeros(3), mount - ball, 0.018)
        frame_a = add_frame(model, f"{side}_lower_{end}_mount", "body", mount)
        frame_c = add_frame(model, f"{side}_lower_{end}_eye", arm, mount - ball)
        along = stiff.lower_front if end == "front" else stiff.lower_rear
        turning = (stiff.rotation, stiff.rotation_damping)
        add_bushing(model, frame_a, frame_c, along=along, loss_time=stiff.loss_time, turning=turning)


def _strut_rod(model: Xml.Element, axle: MacPhersonAxle, side: str, point: dict[str, np.ndarray]) -> None:
    """Add the damper's rod: guided by the tube on the knuckle, held by the top mount."""
    top, foot, rod = point["top_mount"], point["strut_foot"], f"{side}_strut_rod"
    along = foot - top
    length = 0.45 * float(np.linalg.norm(along))
    direction = along / np.linalg.norm(along)
    centre = top + 0.5 * length * direction
    # A rod of 22 mm with its piston: slender, so that only its own thickness resists a turn about its axis.
    slender = axle.rod_mass * length**2 / 12
    inertia = slender * (np.eye(3) - np.outer(direction, direction)) + np.eye(3) * axle.rod_mass * 0.015**2
    link = add_link(model, rod, origin=top, centre=centre, mass=axle.rod_mass, inertia=inertia)
    draw_cylinder(link, f"{rod}_steel", np.zeros(3), length * direction, 0.011)
    add_joint(model, f"{side}_strut_slide", "prismatic", parent=f"{side}_knuckle", child=rod, axis=-direction)
    frame_a = add_frame(model, f"{side}_top_mount_body", "body", top)
    frame_c = add_frame(model, f"{side}_top_mount_rod", rod, np.zeros(3))
    add_bushing(model, frame_a, frame_c, along=axle.top_mount, loss_time=axle.stiffnesses.loss_time)


def write_sdf(axle: MacPhersonAxle) -> str:
    """Return the SDF of an axle as text, ending in a newline."""
    root, model = new_sdf(axle.name)
    add_body(model, mass=axle.body_mass, roll_inertia=axle.body_roll_inertia, held=True)
    for side in ("left", "right"):
        _side(model, axle, side)
    return sdf_text(root, "macpherson")


def main() -> None:
    """Write the shipped SDF over the old one."""
    write_shipped(MACPHERSON.name, write_sdf(MACPHERSON))


if __name__ == "__main__":
    main()
