"""Wear of a spring or bushing of the SDF: the opposite of the lost share of its force.

The part itself stays as in the SDF, also in Drake's plant; the remaining part is the sum of both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rig_sim.multibody import (
    Array,
    Bushing,
    Effect,
    ForceElement,
    Input,
    Motion,
    SpringDamper,
    bushing_wrench,
    spring_wrench,
)


@dataclass(frozen=True)
class LinearLoss(ForceElement):
    """Loss of a part; its inputs are the shares lost of stiffness and damping, 0 to below 1."""

    name: str
    part: Bushing | SpringDamper
    inputs: tuple[Input, ...]

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Remove the lost share of the part's force from both bodies."""
        stiffness, damping = values
        match self.part:
            case Bushing():
                wrench = bushing_wrench(self.part, motion, stiffness=stiffness, damping=damping)
                effect.between(self.part.body_c, self.part.body_a, wrench)
            case SpringDamper():
                wrench = spring_wrench(self.part, motion, stiffness=stiffness, damping=damping)
                effect.between(self.part.body_a, self.part.body_b, wrench)
        return []
