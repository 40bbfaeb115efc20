"""A specimen's YAML: what is mounted, what drives it, what is measured.

The SDF beside it holds bodies, joints and bushings. Whether the names in the YAML exist there is checked by
:mod:`rig_sim.assembly`.
"""

from __future__ import annotations

import reprlib
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
import yaml
from pydantic import BaseModel, Field, ValidationError, model_validator

from rig_sim.elements.rubber import RubberLaw
from rig_sim.elements.strut import StrutLaw
from rig_sim.elements.tyre import TyreLaw
from rig_sim.hydraulics.actuator import DisplacementLoop, Supply
from rig_sim.hydraulics.cylinder import Cylinder
from rig_sim.hydraulics.servovalve import Servovalve
from rig_sim.parameters import STRICT, Finite, NotNegative, Positive, Vector

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
SdfName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*\.sdf$")]

#: What the name of a mirrored part begins with; `right_` takes its place in the mirror image.
LEFT = "left_"
RIGHT = "right_"


class Quantity(StrEnum):
    """What a channel carries."""

    DISPLACEMENT = "displacement"
    FORCE = "force"
    RATIO = "ratio"
    VELOCITY = "velocity"


_UNIT_OF = {Quantity.DISPLACEMENT: "m", Quantity.FORCE: "N", Quantity.RATIO: "1", Quantity.VELOCITY: "m/s"}


class _Part(BaseModel):
    model_config = STRICT

    name: Name
    #: Write the left one only; the right one is its mirror image in the plane y = 0.
    mirrored: bool = False

    @model_validator(mode="after")
    def _is_on_the_left(self) -> Self:
        if self.mirrored and not self.name.startswith(LEFT):
            raise ValueError(f"{self.name!r} is mirrored, so its name must begin with {LEFT!r}")
        return self


class StrutPart(_Part):
    """A strut between two points, given in the model's frame at design height, in metres."""

    body_a: str
    point_a: Vector
    body_b: str
    point_b: Vector
    law: StrutLaw

    @model_validator(mode="after")
    def _has_two_ends(self) -> Self:
        if self.body_a == self.body_b or self.point_a == self.point_b:
            raise ValueError(f"{self.name!r} must join two points of two bodies, apart from each other")
        return self


class RubberPart(_Part):
    """Progressive stiffness and friction in parallel with a bushing of the SDF, along an axis of frame A.

    The mirror image takes the axis mirrored; frame A on the right must have the axes of the left one, as in
    the shipped specimens.
    """

    frame_a: str
    frame_c: str
    axis: Vector
    law: RubberLaw

    @model_validator(mode="after")
    def _has_an_axis(self) -> Self:
        if not np.linalg.norm(self.axis) > 0.0:
            raise ValueError(f"the axis of {self.name!r} is {list(self.axis)}; it must have a direction")
        return self


class TyrePart(_Part):
    """A tyre under a wheel; its drives are height, slope and camber of the road under it, and its speed."""

    wheel: str
    drives: tuple[Name, Name, Name, Name]
    law: TyreLaw


class ActuatorKind(BaseModel):
    """One kind of actuator, used at several places."""

    model_config = STRICT

    valve: Servovalve
    cylinder: Cylinder
    loop: DisplacementLoop


class ActuatorPart(BaseModel):
    """An actuator on a prismatic joint of the SDF; takes the drive of its own name, the wanted stroke in metres."""

    model_config = STRICT

    name: Name
    kind: str
    joint: str


class InputChannel(BaseModel):
    """A drive channel, in the order of the inputs of actuators and tyres."""

    model_config = STRICT

    name: Name
    unit: Literal["m", "m/s", "1"]
    quantity: Quantity
    minimum: Finite
    maximum: Finite
    #: Largest rate, in unit per second; 0 where none is stated.
    slew_limit: NotNegative = 0.0
    label: str

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if self.unit != _UNIT_OF[self.quantity]:
            raise ValueError(f"{self.name!r} is a {self.quantity}, whose unit is not {self.unit!r}")
        if not self.minimum <= 0.0 <= self.maximum or self.minimum == self.maximum:
            raise ValueError(
                f"{self.name!r} goes from {self.minimum:g} to {self.maximum:g}; "
                "it must hold 0, where every playback begins"
            )
        return self


class SpindleChannel(BaseModel):
    """A response: one component of the force at a wheel-force transducer, on the spindle, in the transducer's axes."""

    model_config = STRICT

    name: Name
    #: The weld in the SDF that is the transducer; its child is the wheel.
    transducer: str
    axis: Literal["x", "y", "z"]
    #: Range of the sensor, in N.
    range: Positive
    #: RMS of the sensor's white noise, in N.
    noise_rms: NotNegative
    label: str


class Specimen(BaseModel):
    """A rig and what is mounted on it."""

    model_config = STRICT

    name: Name
    title: str
    #: Name of the SDF, which lies beside the YAML.
    sdf: SdfName
    #: The only sample rate it plays, in Hz, and integration steps per sample.
    sample_rate: Positive
    substeps: Annotated[int, Field(ge=1, le=100)]
    #: Longest drive, in s.
    longest_drive: Positive
    supply: Supply | None = None
    actuator_kinds: dict[str, ActuatorKind] = {}
    actuators: tuple[ActuatorPart, ...] = ()
    struts: tuple[StrutPart, ...] = ()
    rubber: tuple[RubberPart, ...] = ()
    tyres: tuple[TyrePart, ...] = ()
    drives: Annotated[tuple[InputChannel, ...], Field(min_length=1)]
    responses: Annotated[tuple[SpindleChannel, ...], Field(min_length=1)]


class SpecimenError(ValueError):
    """A specimen that cannot be used, in one sentence."""


def load_specimen(path: Path) -> Specimen:
    """Read and check a specimen's YAML.

    Raises
    ------
    SpecimenError
        Where the file is missing, not YAML, or keys are unknown, missing or out of range; names all of them at once.
    """
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SpecimenError(f"specimen {path.name} cannot be read: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise SpecimenError(f"specimen {path.name} is not text in UTF-8.") from error
    except yaml.YAMLError as error:
        raise SpecimenError(f"specimen {path.name} is not YAML: {' '.join(str(error).split())}.") from error
    try:
        return Specimen.model_validate(document)
    except ValidationError as error:
        raise SpecimenError(f"specimen {path.name}: {_problems(error)}.") from error


def _problems(error: ValidationError) -> str:
    texts = []
    for problem in error.errors():
        where = ".".join(str(part) for part in problem["loc"]) or "the document"
        match problem["type"]:
            case "missing":
                texts.append(f"{where} is missing")
            case "extra_forbidden" | "unexpected_keyword_argument":
                texts.append(f"{where} is unknown")
            case "value_error":
                texts.append(f"{where}: {problem['msg'].removeprefix('Value error, ')}")
            case _:
                texts.append(f"{where} is {reprlib.repr(problem['input'])}: {problem['msg']}")
    return "; ".join(texts)


def shipped_specimens() -> dict[str, Path]:
    """Return the YAML files that ship with the project, by rig name."""
    folder = Path(__file__).with_name("specimens")
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}
