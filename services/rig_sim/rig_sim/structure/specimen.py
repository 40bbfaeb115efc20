"""YAML of a structure: beams between points, masses, suspension, damping, shakers and responses.

It is distinguished from a multibody specimen by `kind: state_space` and has no SDF.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import BaseModel, Field, model_validator

from rig_sim.parameters import STRICT, NotNegative, Positive, Vector
from rig_sim.specimen import Axis, InputChannel, Name, Quantity, RigSpecimen, SensorChannel
from rig_sim.structure.beam import Section

KIND = "state_space"

DampingRatio = Annotated[float, Field(gt=0.0, lt=1.0, allow_inf_nan=False)]


class Beam(BaseModel):
    """A straight beam between two points; beams that share a point are rigidly joined there."""

    model_config = STRICT

    name: Name
    section: str
    start: str
    end: str
    width_axis: Vector
    #: Number of finite elements along it.
    elements: Annotated[int, Field(ge=1, le=50)]


class PointMass(BaseModel):
    """A small mass, in kg, fixed at a point."""

    model_config = STRICT

    point: str
    mass: Positive


class Bungee(BaseModel):
    """A soft cord that carries the structure at a point: stiffness along x, y, z in N/m."""

    model_config = STRICT

    point: str
    stiffness: tuple[NotNegative, NotNegative, NotNegative]


class Shaker(InputChannel):
    """A drive: a force on a point along an axis."""

    point: str
    axis: Axis

    @model_validator(mode="after")
    def _pushes(self) -> Self:
        if self.quantity is not Quantity.FORCE:
            raise ValueError(f"{self.name!r} is a {self.quantity}; a shaker's drive is a force in N")
        return self


class Accelerometer(SensorChannel):
    """A response: the acceleration of a point along an axis, in m/s^2."""

    point: str
    axis: Axis

    quantity: ClassVar = Quantity.ACCELERATION


class Damping(BaseModel):
    """Damping ratios: of the modes of the suspension, of the elastic modes in their order, and of all further ones."""

    model_config = STRICT

    suspension: DampingRatio
    elastic: tuple[DampingRatio, ...]
    further: DampingRatio


class StructureSpecimen(RigSpecimen):
    """A structure on soft cords, its shakers and its accelerometers."""

    kind: Literal["state_space"]
    #: Highest played frequency of the modes, in Hz; modes below `suspension_below` are those of the cords.
    highest_mode: Positive
    suspension_below: Positive
    #: Coordinates in metres: x forward, y left, z up.
    points: dict[Name, Vector]
    sections: dict[Name, Section]
    beams: Annotated[tuple[Beam, ...], Field(min_length=1)]
    masses: tuple[PointMass, ...] = ()
    bungees: Annotated[tuple[Bungee, ...], Field(min_length=1)]
    damping: Damping
    drives: Annotated[tuple[Shaker, ...], Field(min_length=1)]
    responses: Annotated[tuple[Accelerometer, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        joined = {point for beam in self.beams for point in (beam.start, beam.end)}
        used = [(beam.name, point) for beam in self.beams for point in (beam.start, beam.end)]
        used += [("a mass", mass.point) for mass in self.masses]
        used += [("a bungee", bungee.point) for bungee in self.bungees]
        used += [(channel.name, channel.point) for channel in (*self.drives, *self.responses)]
        for who, point in used:
            if point not in self.points:
                raise ValueError(f"{who} is at point {point!r}; the points are {', '.join(self.points)}")
            if point not in joined:
                raise ValueError(f"{who} is at point {point!r}, to which no beam leads")
        for beam in self.beams:
            if beam.section not in self.sections:
                raise ValueError(
                    f"{beam.name} has section {beam.section!r}; the sections are {', '.join(self.sections)}"
                )
            along = np.subtract(self.points[beam.end], self.points[beam.start])
            if not np.linalg.norm(np.cross(along, beam.width_axis)) > 0.0:
                raise ValueError(f"{beam.name} has no length, or its width axis runs along it")
        for what, names in (
            ("beams", [beam.name for beam in self.beams]),
            ("drives", [channel.name for channel in self.drives]),
            ("responses", [channel.name for channel in self.responses]),
        ):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(f"two {what} are called {twice[0]!r}; names must differ")
        if not self.suspension_below < self.highest_mode < self.sample_rate / 2.0:
            raise ValueError(
                f"highest_mode is {self.highest_mode:g} Hz; it must lie above suspension_below "
                f"({self.suspension_below:g} Hz) and below half the sample rate ({self.sample_rate / 2.0:g} Hz)"
            )
        return self
