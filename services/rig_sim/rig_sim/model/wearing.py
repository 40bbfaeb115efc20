"""Wearing parts: their place in the assembly, the model's inputs for their loss, and their counted load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig_sim.elements import LinearLoss, Rubber, Strut
from rig_sim.hydraulics import HydraulicActuator
from rig_sim.model.measurement import BushingForce, Instant, bushing_force, find_bushing, is_beside
from rig_sim.multibody import Bushing, Element, Input, Motion, MultibodyTree, SpringDamper, dot, spring_pull, stretch
from rig_sim.specimen import BushingPlace, LinkPlace, Load, PartWear, StrutPlace, mirrored_name

_WEARS_ALREADY = "its part wears already; give each part one wear"


@dataclass(frozen=True)
class WearingPart:
    """A wearing part of the assembly; for a bushing the load cell that measures it, and the rubber beside it."""

    name: str
    wear: PartWear
    #: Inputs of the model with the lost shares: of stiffness and damping, or of damping only.
    inputs: tuple[Input, ...]
    part: BushingForce | SpringDamper | Strut

    def load(self, instant: Instant) -> Any:
        """Return the counted load, in N or m."""
        motion, part = instant.motion, self.part
        if isinstance(part, BushingForce):
            return part.read(instant) if self.wear.load is Load.FORCE else _offset(part, motion)
        if self.wear.load is Load.DEFLECTION:
            rest = part.design_length if isinstance(part, Strut) else part.free_length
            return stretch(motion, part.body_a, part.point_a, part.body_b, part.point_b)[3] - rest
        lost = [instant.inputs[item.name] for item in self.inputs]
        if isinstance(part, Strut):
            return part.force(motion, np.array(lost, dtype=object))
        return spring_pull(part, motion, stiffness=1.0 - lost[0], damping=1.0 - lost[1])


def _offset(mount: BushingForce, motion: Motion) -> Any:
    """Return the offset of frame C from frame A, along the sensor's axis of frame A, in m."""
    bushing = mount.bushing
    frame_a = motion.poses[bushing.body_a] @ bushing.frame_a
    frame_c = motion.poses[bushing.body_c] @ bushing.frame_c
    return dot(frame_a.rotation.T[mount.row], frame_c.origin - frame_a.origin)


def mount_wear(wears: Sequence[PartWear], tree: MultibodyTree, elements: list[Element]) -> tuple[WearingPart, ...]:
    """Add wear to parts among the elements (changed in place) and to springs and bushings of the tree.

    Raises `ValueError` if a place does not exist, is not unique, or wears already.
    """
    parts: list[WearingPart] = []
    for wear in wears:
        for right in (False, True) if wear.mirrored else (False,):
            name = mirrored_name(wear.name) if right else wear.name
            inputs = (Input(f"{name}.stiffness_lost", "1"), Input(f"{name}.damping_lost", "1"))
            try:
                if isinstance(wear.part, StrutPlace):
                    inputs = inputs[1:]
                    part = _worn_strut(wear.part, inputs, elements, right=right)
                else:
                    part = _worn_linear(wear.part, name, inputs, tree, elements, right=right)
            except ValueError as error:
                raise ValueError(f"wear {name!r}: {str(error).rstrip('.')}.") from error
            parts.append(WearingPart(name, wear, inputs, part))
    return tuple(parts)


def _worn_strut(place: StrutPlace, inputs: tuple[Input, ...], elements: list[Element], *, right: bool) -> Strut:
    name = mirrored_name(place.strut) if right else place.strut
    struts = {element.name: element for element in elements if isinstance(element, Strut)}
    if name not in struts:
        raise ValueError(f"it is of strut {name!r}; there are {', '.join(struts) or 'none'}")
    if struts[name].inputs:
        raise ValueError(_WEARS_ALREADY)
    worn = replace(struts[name], inputs=inputs)
    elements[elements.index(struts[name])] = worn
    return worn


def _worn_linear(
    place: BushingPlace | LinkPlace,
    name: str,
    inputs: tuple[Input, ...],
    tree: MultibodyTree,
    elements: list[Element],
    *,
    right: bool,
) -> BushingForce | SpringDamper:
    """Add the loss of a spring or bushing to the elements, and let the rubber beside a bushing lose its stiffness."""
    ends = (place.frame_a, place.frame_c) if isinstance(place, BushingPlace) else (place.body_a, place.body_b)
    first, second = (mirrored_name(end) if right else end for end in ends)
    if isinstance(place, BushingPlace):
        part = find_bushing(tree, first, second)
    else:
        part = _link(tree, first, second, elements)
    if any(isinstance(element, LinearLoss) and element.part is part for element in elements):
        raise ValueError(_WEARS_ALREADY)
    elements.append(LinearLoss(f"{name}_loss", part, inputs))
    if not isinstance(part, Bushing):
        return part
    for index, element in enumerate(elements):
        if isinstance(element, Rubber) and is_beside(element, part):
            elements[index] = replace(element, inputs=inputs[:1])
    assert isinstance(place, BushingPlace)
    return bushing_force(name, part, elements, place.axis)


def _link(tree: MultibodyTree, body_a: str, body_b: str, elements: Sequence[Element]) -> SpringDamper:
    ends = {tree.body_index(body_a), tree.body_index(body_b)}
    found = [spring for spring in tree.springs if {spring.body_a, spring.body_b} == ends]
    if len(found) != 1:
        raise ValueError(
            f"it is of the link from {body_a!r} to {body_b!r}; the SDF has {len(found)} springs between them, and must "
            "have one"
        )
    cells = [element.load_cell for element in elements if isinstance(element, HydraulicActuator)]
    if any(cell is not None and cell.rod is found[0] for cell in cells):
        raise ValueError("it is of a rod with a load cell, which belongs to the rig; name a link of the specimen")
    return found[0]
