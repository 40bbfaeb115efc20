"""Response channels of a specimen's YAML: place and kind of each sensor; the key of the place determines the kind.

`transducer` is a wheel-force transducer, `body` an accelerometer, `strut` a displacement, `frame_a` a load cell in the
mount of a bushing. :mod:`rig_sim.model.measurement` defines their measurements.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, Discriminator, Tag

from rig_sim.parameters import STRICT, Name, NotNegative, Positive, Vector

Axis = Literal["x", "y", "z"]


class Quantity(StrEnum):
    """Physical quantity of a channel."""

    ACCELERATION = "acceleration"
    DISPLACEMENT = "displacement"
    FORCE = "force"
    MOMENT = "moment"
    RATIO = "ratio"
    VELOCITY = "velocity"


UNIT_OF = {
    Quantity.ACCELERATION: "m/s^2",
    Quantity.DISPLACEMENT: "m",
    Quantity.FORCE: "N",
    Quantity.MOMENT: "N*m",
    Quantity.RATIO: "1",
    Quantity.VELOCITY: "m/s",
}


class SensorChannel(BaseModel):
    """A measured channel."""

    model_config = STRICT

    name: Name
    #: Range of the sensor and RMS of its white noise, in the unit of its quantity.
    range: Positive
    noise_rms: NotNegative
    label: str

    @property
    def unit(self: Any) -> str:
        """Unit of its quantity."""
        return UNIT_OF[self.quantity]


class SpindleChannel(SensorChannel):
    """One component of force or moment at a wheel-force transducer, on the spindle, in the transducer's axes.

    The moment, in N*m, is about the transducer's own centre: the origin of the weld, in the shipped rigs the wheel's.
    """

    #: Weld in the SDF that is the transducer; its child is the wheel.
    transducer: str
    axis: Axis
    quantity: Literal[Quantity.FORCE, Quantity.MOMENT] = Quantity.FORCE


class AccelerationChannel(SensorChannel):
    """One component of the acceleration of a point, in the body's axes, without gravity."""

    #: Body that carries the sensor, and its point in the model's frame at design height, in m.
    body: str
    point: Vector
    axis: Axis

    quantity: ClassVar = Quantity.ACCELERATION


class StrutChannel(SensorChannel):
    """The compression of a strut from its design length, positive when shorter."""

    #: Name of the strut; for a mirrored one with left_ or right_.
    strut: str

    quantity: ClassVar = Quantity.DISPLACEMENT


class BushingChannel(SensorChannel):
    """One component of the force on the mount of a bushing (frame A), in its axes, rubber of the YAML included."""

    #: The two frames of the bushing in the SDF.
    frame_a: str
    frame_c: str
    axis: Axis

    quantity: ClassVar = Quantity.FORCE


#: Names of the kinds, which pydantic adds to the path of an error; they are not keys of the YAML.
KINDS = {"body": "an accelerometer", "strut": "a strut's displacement", "frame_a": "a bushing's force"}
SPINDLE = "a wheel-force transducer"


def _kind(document: Any) -> str:
    keys = document if isinstance(document, dict) else vars(document) if isinstance(document, BaseModel) else {}
    return next((kind for key, kind in KINDS.items() if key in keys), SPINDLE)


ResponseChannel = Annotated[
    Annotated[SpindleChannel, Tag(SPINDLE)]
    | Annotated[AccelerationChannel, Tag(KINDS["body"])]
    | Annotated[StrutChannel, Tag(KINDS["strut"])]
    | Annotated[BushingChannel, Tag(KINDS["frame_a"])],
    Discriminator(_kind),
]
