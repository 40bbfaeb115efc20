"""Multibody dynamics of a tree of rigid bodies, written once over generic scalars (traced or plain floats)."""

from rig_sim.multibody.drake_reader import load_plant, read_tree
from rig_sim.multibody.dynamics import accelerate, inertia_in_world
from rig_sim.multibody.effect import Effect, Element, Input
from rig_sim.multibody.kinematics import Motion, move
from rig_sim.multibody.tree import JointKind, MultibodyTree, Pose

__all__ = [
    "Effect",
    "Element",
    "Input",
    "JointKind",
    "Motion",
    "MultibodyTree",
    "Pose",
    "accelerate",
    "inertia_in_world",
    "load_plant",
    "move",
    "read_tree",
]
