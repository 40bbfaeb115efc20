"""Write an SDF piece by piece: links, joints, frames, bushings and rods, with numbers of nine digits."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
from axles import Point

_SHIPPED = Path(__file__).parents[2] / "services" / "rig_sim" / "rig_sim" / "specimen" / "shipped"


def _numbers(values: tuple[float, ...] | np.ndarray) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)


def _pose(position: np.ndarray) -> str:
    return _numbers(position) + " 0 0 0"


def _child(parent: Xml.Element, tag: str, text: str | None = None, **attributes: str) -> Xml.Element:
    element = Xml.SubElement(parent, tag, attributes)
    element.text = text
    return element


def add_link(
    model: Xml.Element, name: str, *, origin: np.ndarray, centre: np.ndarray, mass: float, inertia: np.ndarray
) -> Xml.Element:
    """Add a body.

    Parameters
    ----------
    model : Element
        To add to.
    name : str
        Name of the body.
    origin, centre : (3,)
        Origin of its frame and centre of mass, in the model's frame, in m.
    mass : float
        In kg.
    inertia : (3, 3)
        About the centre, in kg*m^2.

    Returns
    -------
    Element
        The link, to draw on.
    """
    link = _child(model, "link", name=name)
    _child(link, "pose", _pose(origin))
    inertial = _child(link, "inertial")
    _child(inertial, "pose", _pose(centre - origin))
    _child(inertial, "mass", f"{mass:.9g}")
    tensor = _child(inertial, "inertia")
    for row, column, tag in ((0, 0, "ixx"), (0, 1, "ixy"), (0, 2, "ixz"), (1, 1, "iyy"), (1, 2, "iyz"), (2, 2, "izz")):
        _child(tensor, tag, f"{inertia[row, column]:.9g}")
    return link


def point_masses_inertia(points: list[np.ndarray], mass: float) -> tuple[np.ndarray, np.ndarray]:
    """Return centre and inertia of a body whose mass sits in equal parts at its joints, as thick as a 30 mm tube.

    Parameters
    ----------
    points : list of (3,)
        The joints, in m.
    mass : float
        In kg.

    Returns
    -------
    tuple
        Centre of mass (3,) in m, inertia (3, 3) about it in kg*m^2.
    """
    centre = np.mean(points, axis=0)
    inertia = np.eye(3) * mass * 0.015**2
    for point in points:
        arm = point - centre
        inertia += mass / len(points) * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return centre, inertia


def add_frame(model: Xml.Element, name: str, link: str, offset: np.ndarray) -> str:
    """Add a named frame to a body.

    Parameters
    ----------
    model : Element
        To add to.
    name, link : str
        Names of the frame and of its body.
    offset : (3,)
        In the body's frame, in m.

    Returns
    -------
    str
        The name.
    """
    frame = _child(model, "frame", name=name, attached_to=link)
    _child(frame, "pose", _pose(offset), relative_to=link)
    return name


def add_bushing(
    model: Xml.Element,
    frame_a: str,
    frame_c: str,
    *,
    along: Point,
    loss_time: float,
    turning: tuple[Point, Point] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
) -> None:
    """Add a bushing: stiffness along x, y, z with damping = loss_time * stiffness, and of turning both."""
    bushing = _child(model, "drake:linear_bushing_rpy")
    rotation, rotation_damping = turning
    damping = tuple(loss_time * value for value in along)
    _child(bushing, "drake:bushing_frameA", frame_a)
    _child(bushing, "drake:bushing_frameC", frame_c)
    _child(bushing, "drake:bushing_torque_stiffness", _numbers(rotation))
    _child(bushing, "drake:bushing_torque_damping", _numbers(rotation_damping))
    _child(bushing, "drake:bushing_force_stiffness", _numbers(along))
    _child(bushing, "drake:bushing_force_damping", _numbers(damping))


def add_rod(
    model: Xml.Element,
    end_a: tuple[str, np.ndarray],
    end_b: tuple[str, np.ndarray],
    *,
    length: float,
    law: tuple[float, float],
) -> None:
    """Add a stiff two-force link between two points.

    Parameters
    ----------
    model : Element
        To add to.
    end_a, end_b : tuple
        Body, and place (3,) in the body's frame in m.
    length : float
        Without force, in m.
    law : tuple
        Stiffness in N/m and damping in N*s/m.
    """
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


def add_joint(
    model: Xml.Element,
    name: str,
    kind: str,
    *,
    parent: str,
    child: str,
    offset: np.ndarray | None = None,
    axis: np.ndarray | None = None,
) -> None:
    """Add a joint without an actuator of Drake.

    Parameters
    ----------
    model : Element
        To add to.
    name, kind : str
        Name of the joint, and its kind in SDF.
    parent, child : str
        Its bodies.
    offset : (3,), optional
        Where it is in the child's frame, in m.
    axis : (3,), optional
        Axis of rotation or sliding, of any length.
    """
    joint = _child(model, "joint", name=name, type=kind)
    _child(joint, "parent", parent)
    _child(joint, "child", child)
    _child(joint, "pose", _pose(np.zeros(3) if offset is None else offset))
    if axis is not None:
        element = _child(joint, "axis")
        _child(element, "xyz", _numbers(axis / np.linalg.norm(axis)))
        limit = _child(element, "limit")
        _child(limit, "effort", "0")


def draw_cylinder(link: Xml.Element, name: str, start: np.ndarray, end: np.ndarray, radius: float) -> None:
    """Draw a rod.

    Parameters
    ----------
    link : Element
        The body that it is drawn on.
    name : str
        Name of the visual.
    start, end : (3,)
        Relative to the link's origin, in m.
    radius : float
        In m.
    """
    along = end - start
    length = float(np.linalg.norm(along))
    pitch, yaw = np.arccos(np.clip(along[2] / length, -1.0, 1.0)), np.arctan2(along[1], along[0])
    visual = _child(link, "visual", name=name)
    _child(visual, "pose", f"{_numbers((start + end) / 2)} 0 {pitch:.9g} {yaw:.9g}")
    shape = _child(_child(visual, "geometry"), "cylinder")
    _child(shape, "radius", f"{radius:.9g}")
    _child(shape, "length", f"{length:.9g}")


def new_sdf(name: str) -> tuple[Xml.Element, Xml.Element]:
    """Return the root of an empty SDF and its model."""
    root = Xml.Element("sdf", {"version": "1.9", "xmlns:drake": "https://drake.mit.edu"})
    return root, _child(root, "model", name=name)


def sdf_text(root: Xml.Element, generator: str) -> str:
    """Return an SDF as text, ending in a newline; its first line names the module that made it."""
    Xml.indent(root)
    # `rig_sim.specimens` was the first place of these modules. The line must not change: a changed byte would change
    # the content hash of every shipped rig.
    note = f"<!-- Made from hard points by rig_sim.specimens.{generator}; change it in axles.py. -->\n"
    return note + Xml.tostring(root, encoding="unicode") + "\n"


def write_shipped(name: str, text: str) -> None:
    """Write the SDF of a shipped specimen beside its YAML."""
    (_SHIPPED / f"{name}.sdf").write_text(text)
