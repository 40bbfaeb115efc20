"""Multibody dynamics of a tree of rigid bodies, written once over generic scalars (traced or plain floats)."""

from rig_sim.multibody.effect import Element
from rig_sim.multibody.tree import JointKind

__all__ = [
    "Element",
    "JointKind",
]
