"""Write the SDF of a double-wishbone front axle from its hard points.

Both shipped specimens are made here, `python -m rig_sim.specimens.double_wishbone` writes them again: `front_axle` with
its body held and six actuators at the wheels, and `predecessor`, an earlier vehicle of other geometry whose body is
free to heave and roll. A user's specimen needs no such program: any SDF will do.

The lower arm floats in two anisotropic bushings, so that the wheel recedes under longitudinal load. The upper arm turns
on a hinge and meets the knuckle in a bushing that carries the compliance of the upper mounts. The tie rod is a stiff
two-force link.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np

from rig_sim.specimens.axles import ACTUATORS, FRONT_AXLE, PREDECESSOR, ActuatorMount, Axle, Point, Stiffnesses


def _numbers(values: tuple[float, ...] | np.ndarray) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)


def _pose(position: np.ndarray) -> str:
    return _numbers(position) + " 0 0 0"


def _child(parent: Xml.Element, tag: str, text: str | None = None, **attributes: str) -> Xml.Element:
    element = Xml.SubElement(parent, tag, attributes)
    element.text = text
    return element


def _link(
    model: Xml.Element, name: str, *, origin: np.ndarray, centre: np.ndarray, mass: float, inertia: np.ndarray
) -> Xml.Element:
    link = _child(model, "link", name=name)
    _child(link, "pose", _pose(origin))
    inertial = _child(link, "inertial")
    _child(inertial, "pose", _pose(centre - origin))
    _child(inertial, "mass", f"{mass:.9g}")
    tensor = _child(inertial, "inertia")
    for row, column, tag in ((0, 0, "ixx"), (0, 1, "ixy"), (0, 2, "ixz"), (1, 1, "iyy"), (1, 2, "iyz"), (2, 2, "izz")):
        _child(tensor, tag, f"{inertia[row, column]:.9g}")
    return link


def _point_masses_inertia(points: list[np.ndarray], mass: float) -> tuple[np.ndarray, np.ndarray]:
    """Centre and inertia of a body whose mass sits in equal parts at its joints, plus the thickness of a 30 mm tube."""
    centre = np.mean(points, axis=0)
    inertia = np.eye(3) * mass * 0.015**2
    for point in points:
        arm = point - centre
        inertia += mass / len(points) * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return centre, inertia


def _frame(model: Xml.Element, name: str, link: str, offset: np.ndarray) -> str:
    frame = _child(model, "frame", name=name, attached_to=link)
    _child(frame, "pose", _pose(offset), relative_to=link)
    return name


def _bushing(
    model: Xml.Element, frame_a: str, frame_c: str, *, along: Point, stiffnesses: Stiffnesses, ball: bool = False
) -> None:
    """Write a bushing with its stiffness along x, y, z; a ball joint's turns freely."""
    bushing = _child(model, "drake:linear_bushing_rpy")
    loss_time = stiffnesses.ball_loss_time if ball else stiffnesses.loss_time
    damping = tuple(loss_time * value for value in along)
    rotation = (0.0, 0.0, 0.0) if ball else stiffnesses.rotation
    rotation_damping = (0.0, 0.0, 0.0) if ball else stiffnesses.rotation_damping
    _child(bushing, "drake:bushing_frameA", frame_a)
    _child(bushing, "drake:bushing_frameC", frame_c)
    _child(bushing, "drake:bushing_torque_stiffness", _numbers(rotation))
    _child(bushing, "drake:bushing_torque_damping", _numbers(rotation_damping))
    _child(bushing, "drake:bushing_force_stiffness", _numbers(along))
    _child(bushing, "drake:bushing_force_damping", _numbers(damping))


def _rod(
    model: Xml.Element,
    end_a: tuple[str, np.ndarray],
    end_b: tuple[str, np.ndarray],
    *,
    length: float,
    law: tuple[float, float],
) -> None:
    """Write a stiff two-force link between two points, each given by its body and its place in the body's frame."""
    rod = _child(model, "drake:linear_spring_damper")
    for tag, text in (
        ("body_A", end_a[0]),
        ("p_AP", _numbers(end_a[1])),
        ("body_B", end_b[0]),
        ("p_BQ", _numbers(end_b[1])),
        ("free_length", f"{length:.12g}"),
        ("stiffness", f"{law[0]:.9g}"),
        ("damping", f"{law[1]:.9g}"),
    ):
        _child(rod, f"drake:linear_spring_damper_{tag}", text)


def _joint(
    model: Xml.Element,
    name: str,
    kind: str,
    *,
    parent: str,
    child: str,
    offset: np.ndarray | None = None,
    axis: np.ndarray | None = None,
) -> None:
    joint = _child(model, "joint", name=name, type=kind)
    _child(joint, "parent", parent)
    _child(joint, "child", child)
    _child(joint, "pose", _pose(np.zeros(3) if offset is None else offset))
    if axis is not None:
        element = _child(joint, "axis")
        _child(element, "xyz", _numbers(axis / np.linalg.norm(axis)))
        limit = _child(element, "limit")
        _child(limit, "effort", "0")


def _cylinder(link: Xml.Element, name: str, start: np.ndarray, end: np.ndarray, radius: float) -> None:
    """Draw a rod from `start` to `end`, both relative to the link's origin."""
    along = end - start
    length = float(np.linalg.norm(along))
    pitch, yaw = np.arccos(np.clip(along[2] / length, -1.0, 1.0)), np.arctan2(along[1], along[0])
    visual = _child(link, "visual", name=name)
    _child(visual, "pose", f"{_numbers((start + end) / 2)} 0 {pitch:.9g} {yaw:.9g}")
    shape = _child(_child(visual, "geometry"), "cylinder")
    _child(shape, "radius", f"{radius:.9g}")
    _child(shape, "length", f"{length:.9g}")


def _body(model: Xml.Element, axle: Axle) -> None:
    height = np.array([0.0, 0.0, 0.55])
    origin = np.zeros(3)
    roll = axle.masses.body_roll_inertia
    inertia = np.diag([roll, 0.4 * roll, roll])
    _link(model, "body", origin=origin, centre=height, mass=axle.masses.body, inertia=inertia)
    if axle.body_held:
        _joint(model, "body_clamp", "fixed", parent="world", child="body")
        return
    # Drake has no joint that heaves and rolls; a light carriage between two joints does.
    _link(model, "heave_carriage", origin=origin, centre=height, mass=10.0, inertia=np.eye(3))
    _joint(model, "body_heave", "prismatic", parent="world", child="heave_carriage", axis=np.array([0.0, 0.0, 1.0]))
    _joint(model, "body_roll", "revolute", parent="heave_carriage", child="body", axis=np.array([1.0, 0.0, 0.0]))


def _side(model: Xml.Element, axle: Axle, side: str) -> None:
    mirror = np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])
    point = {name: np.array(value) * mirror for name, value in vars(axle.points).items()}
    masses, stiff = axle.masses, axle.stiffnesses
    lower, upper, wheel = point["lower_ball"], point["upper_ball"], point["wheel_centre"]

    centre, inertia = _point_masses_inertia(
        [lower, point["lower_front_bushing"], point["lower_rear_bushing"]], masses.lower_arm
    )
    link = _link(model, f"{side}_lower_arm", origin=lower, centre=centre, mass=masses.lower_arm, inertia=inertia)
    for end in ("front", "rear"):
        mount = point[f"lower_{end}_bushing"]
        _cylinder(link, f"{side}_lower_arm_{end}_tube", np.zeros(3), mount - lower, 0.018)
        frame_a = _frame(model, f"{side}_lower_{end}_mount", "body", mount)
        frame_c = _frame(model, f"{side}_lower_{end}_eye", f"{side}_lower_arm", mount - lower)
        along = stiff.lower_front if end == "front" else stiff.lower_rear
        _bushing(model, frame_a, frame_c, along=along, stiffnesses=stiff)

    hinge_front, hinge_rear = point["upper_front_hinge"], point["upper_rear_hinge"]
    centre, inertia = _point_masses_inertia([upper, hinge_front, hinge_rear], masses.upper_arm)
    hinge = (hinge_front + hinge_rear) / 2
    link = _link(model, f"{side}_upper_arm", origin=hinge, centre=centre, mass=masses.upper_arm, inertia=inertia)
    for end, mount in (("front", hinge_front), ("rear", hinge_rear)):
        _cylinder(link, f"{side}_upper_arm_{end}_tube", upper - hinge, mount - hinge, 0.014)
    _joint(
        model,
        f"{side}_upper_hinge",
        "revolute",
        parent="body",
        child=f"{side}_upper_arm",
        axis=hinge_front - hinge_rear,
    )

    knuckle_inertia = np.diag([0.30, 0.24, 0.18]) * masses.knuckle / 18.0
    knuckle_centre = wheel + np.array([0.0, -0.05, 0.01]) * mirror
    link = _link(
        model,
        f"{side}_knuckle",
        origin=wheel,
        centre=knuckle_centre,
        mass=masses.knuckle,
        inertia=knuckle_inertia,
    )
    for name, end in (("lower", lower), ("upper", upper), ("steer", point["tie_rod_outer"])):
        _cylinder(link, f"{side}_knuckle_{name}", np.zeros(3), end - wheel, 0.02)
    _joint(
        model,
        f"{side}_lower_ball",
        "ball",
        parent=f"{side}_lower_arm",
        child=f"{side}_knuckle",
        offset=lower - wheel,
    )
    frame_a = _frame(model, f"{side}_upper_ball_arm", f"{side}_upper_arm", upper - hinge)
    frame_c = _frame(model, f"{side}_upper_ball_knuckle", f"{side}_knuckle", upper - wheel)
    _bushing(model, frame_a, frame_c, along=stiff.upper_ball, stiffnesses=stiff, ball=True)
    inner, outer = point["tie_rod_inner"], point["tie_rod_outer"]
    length = float(np.linalg.norm(outer - inner))
    law = (stiff.tie_rod, stiff.tie_rod_damping)
    _rod(model, ("body", inner), (f"{side}_knuckle", outer - wheel), length=length, law=law)

    wheel_inertia = np.diag([0.55, 0.95, 0.55]) * masses.wheel / 22.0
    link = _link(model, f"{side}_wheel", origin=wheel, centre=wheel, mass=masses.wheel, inertia=wheel_inertia)
    half_width = np.array([0.0, 0.10, 0.0]) * mirror
    _cylinder(link, f"{side}_wheel_disc", -half_width, half_width, 0.16 if axle.body_held else float(wheel[2]))
    _joint(model, f"{side}_wheel_force_transducer", "fixed", parent=f"{side}_knuckle", child=f"{side}_wheel")
    if axle.body_held:
        for mount in ACTUATORS:
            _actuator(model, axle, side, mount, mirror=mirror)


def _actuator(model: Xml.Element, axle: Axle, side: str, mount: ActuatorMount, *, mirror: np.ndarray) -> None:
    wheel = np.array(axle.points.wheel_centre) * mirror
    offset, rod = np.array(mount.offset) * mirror, np.array(mount.rod) * mirror
    piston_end = wheel + offset + rod
    name = f"{side}_{mount.direction}_piston"
    # A positive stroke moves the wheel along the positive axis of ISO 8855, whichever side the cylinder stands on.
    axis = np.abs(np.array(mount.rod))
    inertia = np.eye(3) * mount.piston_mass * 0.02**2
    link = _link(model, name, origin=piston_end, centre=piston_end, mass=mount.piston_mass, inertia=inertia)
    _cylinder(link, f"{name}_rod", np.zeros(3), 0.35 * rod, 0.025)
    _joint(model, f"{side}_{mount.direction}_stroke", "prismatic", parent="world", child=name, axis=axis)
    law = (axle.stiffnesses.actuator_rod, axle.stiffnesses.actuator_rod_damping)
    _rod(model, (name, np.zeros(3)), (f"{side}_wheel", offset), length=float(np.linalg.norm(rod)), law=law)


def write_sdf(axle: Axle) -> str:
    """Return the SDF of an axle as text, ending in a newline."""
    root = Xml.Element("sdf", {"version": "1.9", "xmlns:drake": "https://drake.mit.edu"})
    model = _child(root, "model", name=axle.name)
    _body(model, axle)
    for side in ("left", "right"):
        _side(model, axle, side)
    Xml.indent(root)
    note = "<!-- Made from hard points by rig_sim.specimens.double_wishbone; change it in axles.py. -->\n"
    return note + Xml.tostring(root, encoding="unicode") + "\n"


def main() -> None:
    """Write the shipped specimens into this folder."""
    for axle in (FRONT_AXLE, PREDECESSOR):
        Path(__file__).with_name(f"{axle.name}.sdf").write_text(write_sdf(axle))


if __name__ == "__main__":
    main()
