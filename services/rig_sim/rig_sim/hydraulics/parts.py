"""What a specimen's YAML says of its hydraulics: kinds of actuators, in displacement or force control, and where."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Discriminator, Tag

from rig_sim.hydraulics.cylinder import Cylinder
from rig_sim.hydraulics.loops import DisplacementLoop, ForceLoop
from rig_sim.hydraulics.servovalve import Servovalve
from rig_sim.parameters import STRICT, Name

#: Name of the supply that a specimen gives as `supply`, and of every actuator's that names none.
MAIN_SUPPLY = "supply"
#: What an actuator may control: the tags of its kinds.
CONTROLS = ("displacement", "force")


class DisplacementKind(BaseModel):
    """A kind of actuator whose drive is a stroke in metres."""

    model_config = STRICT

    control: Literal["displacement"] = "displacement"
    valve: Servovalve
    cylinder: Cylinder
    loop: DisplacementLoop


class ForceKind(BaseModel):
    """A kind of actuator whose drive is a force on the specimen in newtons."""

    model_config = STRICT

    control: Literal["force"]
    valve: Servovalve
    cylinder: Cylinder
    loop: ForceLoop


def _control(kind: Any) -> Any:
    """Say which kind a document or a model is; displacement control unless it says otherwise."""
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
    """An actuator on a prismatic joint of the SDF; takes the drive of its own name, a wanted stroke or force."""

    model_config = STRICT

    name: Name
    kind: str
    joint: str
    #: Which supply feeds it.
    supply: str = MAIN_SUPPLY
