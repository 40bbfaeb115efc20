"""Hydraulics in a specimen's YAML, and their mounting on the tree: joints, rods and load cells by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, Discriminator, Tag

from rig_sim.hydraulics.actuator import HydraulicActuator, LoadCell
from rig_sim.hydraulics.cylinder import Cylinder
from rig_sim.hydraulics.loops import DisplacementLoop, Feedback, ForceLoop
from rig_sim.hydraulics.servovalve import Servovalve
from rig_sim.hydraulics.supply import Supply
from rig_sim.multibody import Joint, JointKind, MultibodyTree
from rig_sim.parameters import STRICT, Name

#: Name of the supply given as `supply`, and of the supply of every actuator that names none.
MAIN_SUPPLY = "supply"
#: Controlled quantities of an actuator: the tags of its kinds.
CONTROLS = ("displacement", "force")


class _Kind(BaseModel):
    model_config = STRICT

    valve: Servovalve
    cylinder: Cylinder


class DisplacementKind(_Kind):
    """A kind of actuator whose drive is a stroke in metres."""

    control: Literal["displacement"] = "displacement"
    loop: DisplacementLoop


class ForceKind(_Kind):
    """A kind of actuator whose drive is a force on the specimen in newtons."""

    control: Literal["force"]
    loop: ForceLoop


def _control(kind: Any) -> Any:
    """Return the kind of a document or a model; displacement control by default."""
    if isinstance(kind, dict):
        return kind.get("control", "displacement")
    return getattr(kind, "control", None)


ActuatorKind = Annotated[
    Annotated[DisplacementKind, Tag("displacement")] | Annotated[ForceKind, Tag("force")],
    Discriminator(
        _control,
        custom_error_type="unknown_control",
        custom_error_message="control must be 'displacement' or 'force'",
    ),
]


class ActuatorPart(BaseModel):
    """An actuator on a prismatic joint of the SDF; takes the drive with the same name, a desired stroke or force."""

    model_config = STRICT

    name: Name
    kind: str
    joint: str
    #: Name of the supply that feeds it.
    supply: str = MAIN_SUPPLY


SupplyLike = TypeVar("SupplyLike", Supply, dict[str, Any])


def all_supplies(main: SupplyLike | None, others: Mapping[str, SupplyLike]) -> dict[str, SupplyLike]:
    """Return the supplies, or their documents, by name, the main one first."""
    if main is not None and MAIN_SUPPLY in others:
        raise ValueError(f"supplies has one called {MAIN_SUPPLY!r} beside supply; names must differ.")
    return ({} if main is None else {MAIN_SUPPLY: main}) | dict(others)


def mount_actuator(
    part: ActuatorPart, kinds: Mapping[str, ActuatorKind], supplies: Mapping[str, Supply], tree: MultibodyTree
) -> HydraulicActuator:
    """Return the actuator of a part."""
    kind = kinds.get(part.kind)
    if kind is None:
        raise ValueError(f"actuator {part.name!r} is of kind {part.kind!r}; actuator_kinds has {_list(kinds)}.")
    if not supplies:
        raise ValueError("it has actuators but no supply; give its pressures.")
    supply = supplies.get(part.supply)
    if supply is None:
        raise ValueError(f"actuator {part.name!r} is fed by supply {part.supply!r}; there are {_list(supplies)}.")
    joint = tree.joint(part.joint)
    if joint.kind is not JointKind.PRISMATIC:
        raise ValueError(
            f"actuator {part.name!r} is on joint {part.joint!r}, which is {joint.kind.name.lower()}; "
            "a cylinder needs a prismatic joint."
        )
    middle = 0.5 * (supply.supply_pressure + supply.return_pressure)
    feedback = kind.loop.feedback if isinstance(kind, ForceKind) else None
    return HydraulicActuator(
        name=part.name,
        joint_position=joint.position_start,
        joint_velocity=joint.velocity_start,
        valve=kind.valve,
        cylinder=kind.cylinder,
        loop=kind.loop,
        supply=part.supply,
        middle_pressure=middle,
        load_cell=_load_cell(part, joint, tree) if feedback is Feedback.LOAD_CELL else None,
    )


def _load_cell(part: ActuatorPart, joint: Joint, tree: MultibodyTree) -> LoadCell:
    rods = [spring for spring in tree.springs if joint.child in (spring.body_a, spring.body_b)]
    if len(rods) != 1:
        raise ValueError(
            f"actuator {part.name!r} feeds back its load cell, but {len(rods)} rods (drake:linear_spring_damper) hold "
            f"its piston {tree.bodies[joint.child].name!r}; it takes exactly one, or feedback: pressure."
        )
    return LoadCell(
        rod=rods[0],
        piston=joint.child,
        joint=tree.joints.index(joint),
        piston_mass=tree.bodies[joint.child].mass,
        gravity=tree.gravity,
    )


def check_limits(actuator: HydraulicActuator, supply: Supply, *, minimum: float, maximum: float) -> None:
    """Refuse a drive that its actuator cannot reach."""
    if isinstance(actuator.loop, DisplacementLoop):
        half = actuator.cylinder.half_stroke
        if max(maximum, -minimum) > half:
            raise ValueError(
                f"drive {actuator.name!r} goes from {minimum:g} to {maximum:g} m; "
                f"its cylinder ends at {half:g} m either way."
            )
        return
    area_a, area_b = actuator.cylinder.areas
    push = supply.supply_pressure * area_a - supply.return_pressure * area_b
    pull = supply.supply_pressure * area_b - supply.return_pressure * area_a
    if maximum > push or -minimum > pull:
        raise ValueError(
            f"drive {actuator.name!r} goes from {minimum:g} to {maximum:g} N; "
            f"its cylinder pulls with {-pull:.0f} N and pushes with {push:.0f} N at most."
        )


def _list(names: Mapping[str, object]) -> str:
    return ", ".join(names) or "none"
