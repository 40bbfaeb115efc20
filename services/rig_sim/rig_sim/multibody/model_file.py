"""What Drake does not refuse in a model file: unknown tags of a URDF, links without inertia, springs that push away.

Unknown tags of an SDF are refused by Drake's strict parsing.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree as Xml

#: What of a URDF this simulator, or Drake for it, reads or may leave aside. Drake's own tags stand with their prefix.
_KNOWN = {
    "robot": {
        "link",
        "joint",
        "frame",
        "material",
        "drake:joint",
        "drake:linear_bushing_rpy",
        "drake:linear_spring_damper",
    },
    "link": {"inertial", "visual", "collision"},
    "inertial": {"origin", "mass", "inertia"},
    "joint": {"origin", "parent", "child", "axis", "limit", "dynamics"},
    "drake:joint": {"origin", "parent", "child", "axis", "limit", "dynamics"},
}
_DRAKE = "{https://drake.mit.edu}"
#: What Drake ends the whole process over, where it is negative: ends of the tags of its bushings and springs.
_NOT_NEGATIVE = ("_stiffness", "_damping")
_ABOVE_ZERO = "_free_length"
#: Numbers that each constant of a force element has; Drake goes on without one that it cannot read.
_NUMBERS = {"linear_bushing_rpy": 3, "linear_spring_damper": 1}
_WORLD = "world"


def check_model_file(path: Path) -> None:
    """Check what Drake does not."""
    try:
        root = Xml.parse(path).getroot()
    except Xml.ParseError as error:
        raise ValueError(f"{path.name} is not XML: {error}.") from error
    urdf = path.suffix == ".urdf"
    if root.tag != ("robot" if urdf else "sdf"):
        raise ValueError(
            f"{path.name} begins with the tag {root.tag!r}; a {'URDF' if urdf else 'SDF'} begins with "
            f"{'robot' if urdf else 'sdf'!r}."
        )
    if urdf:
        _check_tags(path, root)
    for link in root.iter("link"):
        name = link.get("name", "")
        if name == _WORLD:
            continue
        mass = link.find("inertial/mass")
        if mass is None:
            raise ValueError(f"{path.name}: link {name!r} has no inertial with a mass; give it mass and inertia.")
        said = (mass.get("value", "") if urdf else mass.text or "").strip()
        if not _is_positive(said):
            raise ValueError(
                f"{path.name}: link {name!r} has the mass {said!r}; what moves needs a mass above 0 kg, what stands "
                "still a frame in place of a link."
            )
    for kind in _NUMBERS:
        for element in [*root.iter(f"{_DRAKE}{kind}"), *root.iter(f"drake:{kind}")]:
            _check_constants(path, kind, element)


def _check_constants(path: Path, kind: str, element: Xml.Element) -> None:
    for child in element:
        tag = child.tag.replace(_DRAKE, "drake:")
        if not tag.endswith((*_NOT_NEGATIVE, _ABOVE_ZERO)):
            continue
        said = (child.get("value") or child.text or "").strip()
        try:
            values = [float(number) for number in said.split()]
        except ValueError:
            values = []
        count = _NUMBERS[kind]
        allowed = "a length above 0 m" if tag.endswith(_ABOVE_ZERO) else "constants of 0 or more"
        if count > 1:
            allowed = f"{count} {allowed}"
        above = all(value > 0.0 if tag.endswith(_ABOVE_ZERO) else value >= 0.0 for value in values)
        if not (len(values) == count and above and all(math.isfinite(value) for value in values)):
            raise ValueError(f"{path.name}: {tag} of a {kind} is {said!r}; it takes {allowed}.")


def _is_positive(text: str) -> bool:
    try:
        return math.isfinite(float(text)) and float(text) > 0.0
    except ValueError:
        return False


def _check_tags(path: Path, parent: Xml.Element) -> None:
    tag = parent.tag.replace(_DRAKE, "drake:")
    for child in parent:
        name = child.tag.replace(_DRAKE, "drake:")
        if name not in _KNOWN[tag]:
            raise ValueError(
                f"{path.name}: tag {name!r} in {tag} {parent.get('name', '')!r} is unknown; known there are "
                f"{', '.join(sorted(_KNOWN[tag]))}."
            )
        if name in _KNOWN:
            _check_tags(path, child)
