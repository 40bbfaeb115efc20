"""Multibody dynamics of a tree of rigid bodies, written once over generic scalars (traced or plain floats)."""

from rig_sim.multibody.drake_reader import load_plant, read_tree
from rig_sim.multibody.dynamics import Accelerations, accelerate, inertia_in_world
from rig_sim.multibody.forces import (
    Effect,
    Element,
    ForceElement,
    Input,
    Line,
    Offering,
    add_linear_elements,
    bushing_wrench,
    spring_pull,
    spring_wrench,
    stretch,
)
from rig_sim.multibody.kinematics import Motion, move
from rig_sim.multibody.spatial import ZERO, Array, Spatial, cross, dot, vector, wrench_at
from rig_sim.multibody.tree import (
    Body,
    Bushing,
    Joint,
    JointKind,
    MultibodyTree,
    Pose,
    SpringDamper,
)

__all__ = [
    "ZERO",
    "Accelerations",
    "Array",
    "Body",
    "Bushing",
    "Effect",
    "Element",
    "ForceElement",
    "Input",
    "Joint",
    "JointKind",
    "Line",
    "Motion",
    "MultibodyTree",
    "Offering",
    "Pose",
    "Spatial",
    "SpringDamper",
    "accelerate",
    "add_linear_elements",
    "bushing_wrench",
    "cross",
    "dot",
    "inertia_in_world",
    "load_plant",
    "move",
    "read_tree",
    "spring_pull",
    "spring_wrench",
    "stretch",
    "vector",
    "wrench_at",
]
