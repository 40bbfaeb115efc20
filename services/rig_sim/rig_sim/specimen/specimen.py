"""YAML of a specimen: mounted parts, drives, responses.

The SDF beside it holds bodies, joints and bushings. The names in the YAML are checked against it by
:mod:`rig_sim.model.assembly`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import BaseModel, Field, ValidationError, model_validator

from duralab_gateway.motion import Approach, Source, Watchdog
from duralab_settings import YamlError, explain_validation, parse_yaml, read_yaml_text
from rig_sim.compile import Method
from rig_sim.elements import AntiRollBarLaw, RubberLaw, StrutLaw, TyreLaw
from rig_sim.hydraulics import CONTROLS, ActuatorKind, ActuatorPart, Supply
from rig_sim.parameters import STRICT, Finite, Name, NotNegative, Positive, RigName, Vector
from rig_sim.specimen.parts import MirroredPart, mirrored_name
from rig_sim.specimen.responses import KINDS, SPINDLE, UNIT_OF, Quantity, ResponseChannel
from rig_sim.specimen.wear import PLACES, Wear, WearKind


class Range(BaseModel):
    """Permitted range of a monitored value, in its own unit; either end may be open."""

    model_config = STRICT

    minimum: Finite | None = None
    maximum: Finite | None = None

    @model_validator(mode="after")
    def _is_a_range(self) -> Range:
        if self.minimum is None and self.maximum is None:
            raise ValueError("neither minimum nor maximum is given; give at least one")
        if self.minimum is not None and self.maximum is not None and not self.minimum < self.maximum:
            raise ValueError(f"minimum is {self.minimum:g}; it must be below maximum, {self.maximum:g}")
        return self


class WatchdogLimits(BaseModel):
    """Limits of a specimen's watchdogs; values that are not named are not watched."""

    model_config = STRICT

    #: Largest magnitude of responses, by channel, in the channel's unit.
    responses: dict[str, Positive] = {}
    #: Largest magnitude of command minus achieved value, by drive, in the drive's unit. Leave out an actuator that
    #: yields under load on purpose.
    following_errors: dict[str, Positive] = {}
    #: Monitored values of the elements, pressures above all, e.g. `left_vertical.load_pressure` (share of the largest).
    monitored: dict[str, Range] = {}


def set_up_watchdogs(
    limits: WatchdogLimits,
    *,
    responses: Mapping[str, str],
    drives: Mapping[str, str],
    followed: Sequence[str],
    monitored: Sequence[str],
) -> tuple[Watchdog, ...]:
    """Return the watchdogs for the limits, from units by channel and monitored values, in the order of their rows.

    Drives without an actuator have no following error. Raises `ValueError` if a name does not exist; the sentence
    lists the existing ones.
    """
    dogs = []
    for source, given, rows, allowed in (
        (Source.RESPONSE, limits.responses, list(responses), list(responses)),
        (Source.FOLLOWING_ERROR, limits.following_errors, list(drives), list(followed)),
        (Source.MONITORED, limits.monitored, list(monitored), list(monitored)),
    ):
        units = {Source.RESPONSE: responses, Source.FOLLOWING_ERROR: drives, Source.MONITORED: {}}[source]
        for name, limit in given.items():
            if name not in allowed:
                raise ValueError(
                    f"a watchdog is set on the {source} of {name!r}; there are {', '.join(allowed) or 'none'}."
                )
            ends = limit if isinstance(limit, Range) else Range(minimum=-limit, maximum=limit)
            dogs.append(
                Watchdog(
                    source=source,
                    name=name,
                    row=rows.index(name),
                    unit=units.get(name, ""),
                    minimum=-np.inf if ends.minimum is None else ends.minimum,
                    maximum=np.inf if ends.maximum is None else ends.maximum,
                )
            )
    return tuple(dogs)


_VARIANT_OF = "variant_of"
_BESIDE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*\.yaml")


class SpecimenError(ValueError):
    """A specimen that cannot be used, in one sentence."""


def read_document(path: Path) -> Any:
    """Read a YAML file; if it has `variant_of: NAME.yaml`, merged with that file in the same folder.

    The lists and mappings of a variant are added to the other's, and its single values replace the other's. Raises
    `SpecimenError` if a file is missing or not YAML, or a variant is of a missing file, of itself, or has another type
    of value under a key.
    """
    *variants, first = document_files(path)
    document = _read(first)
    for variant in reversed(variants):
        if not isinstance(document, dict):
            raise SpecimenError(f"specimen {variant.name}: {first.name} is no specimen; name one.")
        changes = {key: value for key, value in _read(variant).items() if key != _VARIANT_OF}
        document = _merged(document, changes, place=f"specimen {variant.name}: ")
    return document


def document_files(path: Path) -> tuple[Path, ...]:
    """Return the files of a document: its own, the one it is a variant of, and so on."""
    files = [path]
    while (base := _base(files[-1], _read(files[-1]))) is not None:
        if base in files:
            raise SpecimenError(f"specimen {path.name}: {base.name} is a variant of itself; name another one.")
        files.append(base)
    return tuple(files)


def _base(path: Path, document: Any) -> Path | None:
    if not isinstance(document, dict) or _VARIANT_OF not in document:
        return None
    name = document[_VARIANT_OF]
    if not isinstance(name, str) or not _BESIDE.fullmatch(name):
        raise SpecimenError(f"specimen {path.name}: variant_of is {name!r}; it must name a YAML beside it, NAME.yaml.")
    return path.with_name(name)


def _merged(base: dict[Any, Any], changes: dict[Any, Any], *, place: str) -> dict[Any, Any]:
    merged = dict(base)
    for key, value in changes.items():
        old = merged.get(key)
        if isinstance(old, dict | list) and not isinstance(value, type(old)):
            kind = "a list" if isinstance(old, list) else "a mapping"
            raise SpecimenError(f"{place}{key} is {kind} in what it varies; give {kind} of what to add.")
        if isinstance(old, dict) and isinstance(value, dict):
            merged[key] = _merged(old, value, place=f"{place}{key}.")
        elif isinstance(old, list) and isinstance(value, list):
            merged[key] = [*old, *value]
        else:
            merged[key] = value
    return merged


# A rig's file is read for its name, kind, parts and content; its text is parsed once.
_parse_once = lru_cache(maxsize=16)(parse_yaml)


def _read(path: Path) -> Any:
    try:
        return deepcopy(_parse_once(read_yaml_text(path)))
    except OSError as error:
        raise SpecimenError(f"specimen {path.name} cannot be read: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise SpecimenError(f"specimen {path.name} is not text in UTF-8.") from error
    except YamlError as error:
        raise SpecimenError(f"specimen {path.name} is not YAML: {error}.") from error


SdfName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*\.(sdf|urdf)$")]


class StrutPart(MirroredPart):
    """A strut between two points, given in the model's frame at design height, in metres."""

    body_a: str
    point_a: Vector
    body_b: str
    point_b: Vector
    law: StrutLaw

    @model_validator(mode="after")
    def _has_two_ends(self) -> Self:
        if self.body_a == self.body_b or self.point_a == self.point_b:
            raise ValueError(f"{self.name!r} must join two points of two bodies, except each other")
        return self


class RubberPart(MirroredPart):
    """Progressive stiffness and friction in parallel with a bushing of the SDF, along an axis of frame A.

    The mirror image has the mirrored axis; frame A on the right must have the axes of the left one, as in the shipped
    specimens.
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


class AntiRollBarPart(BaseModel):
    """An anti-roll bar across the car, given by its left end in the model's frame at design height, in metres.

    The right end is its mirror image. The bar's axis is across the car, through the lever's pivot.
    """

    model_config = STRICT

    name: Name
    body: str
    pivot: Vector
    lever_end: Vector
    link_body: str
    link_point: Vector
    law: AntiRollBarLaw

    @model_validator(mode="after")
    def _has_a_left_and_a_right(self) -> Self:
        if mirrored_name(self.link_body) == self.link_body:
            raise ValueError(f"{self.name!r} has its link on {self.link_body!r}; name the left one of a pair")
        return self


class TyrePart(MirroredPart):
    """A tyre under a wheel; its drives are height, slope and camber of the road under it, and its speed."""

    wheel: str
    drives: tuple[Name, Name, Name, Name]
    law: TyreLaw


class InputChannel(BaseModel):
    """A drive channel, in the order of the inputs of actuators and tyres."""

    model_config = STRICT

    name: Name
    unit: Literal["m", "m/s", "N", "1"]
    quantity: Quantity
    minimum: Finite
    maximum: Finite
    #: Largest rate, in unit per second; 0 if not stated.
    slew_limit: NotNegative = 0.0
    #: Speed with the valve at its stop, under the loads of a test, in unit per second; 0 if not stated.
    actuator_speed: NotNegative = 0.0
    label: str

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if self.unit != UNIT_OF[self.quantity]:
            raise ValueError(f"{self.name!r} is a {self.quantity}, whose unit is not {self.unit!r}")
        if not self.minimum <= 0.0 <= self.maximum or self.minimum == self.maximum:
            raise ValueError(
                f"{self.name!r} goes from {self.minimum:g} to {self.maximum:g}; "
                "it must hold 0, where every playback begins"
            )
        return self


class RigSpecimen(BaseModel):
    """Common keys of the YAML of every kind of rig."""

    model_config = STRICT

    name: RigName
    title: str
    #: Sample rate that the rig plays, in Hz.
    sample_rate: Positive
    #: Longest drive, in s.
    longest_drive: Positive
    #: Ramp to a drive's first sample, and back to rest.
    approach: Approach = Approach()
    #: Watchdogs that make the rig ramp down and latch during a playback.
    watchdogs: WatchdogLimits = WatchdogLimits()
    #: Channels of the kind of rig: an `InputChannel` each, and a `SensorChannel` each.
    drives: Annotated[tuple[Any, ...], Field(min_length=1)]
    responses: Annotated[tuple[Any, ...], Field(min_length=1)]

    def set_up_watchdogs(self, *, followed: Sequence[str] = (), monitored: Sequence[str] = ()) -> tuple[Watchdog, ...]:
        """Return its watchdogs; see :func:`rig_sim.specimen.watchdogs.set_up_watchdogs`."""
        responses, drives = (
            {channel.name: channel.unit for channel in channels} for channels in (self.responses, self.drives)
        )
        try:
            return set_up_watchdogs(
                self.watchdogs, responses=responses, drives=drives, followed=followed, monitored=monitored
            )
        except ValueError as error:
            raise SpecimenError(f"specimen {self.name}: {error}") from error


class Specimen(RigSpecimen):
    """A rig and its mounted specimen."""

    #: Name of the SDF or URDF, in the folder of the YAML.
    sdf: SdfName
    #: Integration steps per sample.
    substeps: Annotated[int, Field(ge=1, le=100)]
    #: Method of a step; the engine drake chooses its own.
    integrator: Method = Method.RUNGE_KUTTA_4
    supply: Supply | None = None
    #: Further supplies, e.g. one per side; an actuator names the one that feeds it.
    supplies: dict[Name, Supply] = {}
    actuator_kinds: dict[str, ActuatorKind] = {}
    actuators: tuple[ActuatorPart, ...] = ()
    struts: tuple[StrutPart, ...] = ()
    rubber: tuple[RubberPart, ...] = ()
    anti_roll_bars: tuple[AntiRollBarPart, ...] = ()
    tyres: tuple[TyrePart, ...] = ()
    #: Wear from run to run.
    wear: tuple[Wear, ...] = ()
    drives: Annotated[tuple[InputChannel, ...], Field(min_length=1)]
    responses: Annotated[tuple[ResponseChannel, ...], Field(min_length=1)]


_Document = TypeVar("_Document", bound=BaseModel)


def load_specimen(path: Path) -> Specimen:
    """Read and check a multibody specimen's YAML.

    Parameters
    ----------
    path : Path
        The YAML.

    Returns
    -------
    Specimen
        Checked specimen.

    Raises
    ------
    SpecimenError
        The file is missing, not YAML, or keys are unknown, missing or out of range; names all of them at once.
    """
    return read_specimen(path, Specimen)


def read_specimen(path: Path, kind: type[_Document]) -> _Document:
    """Read and check a YAML of a kind of specimen; raises as `load_specimen`."""
    try:
        return kind.model_validate(read_document(path))
    except ValidationError as error:
        raise SpecimenError(f"specimen {path.name}: {explain_problems(error, kind)}") from error


def explain_problems(error: ValidationError, kind: type[BaseModel]) -> str:
    """Return the errors of a document in one sentence."""
    # A union adds the name of the chosen kind to the path.
    hidden = {SPINDLE, *KINDS.values(), *CONTROLS, *PLACES, *WearKind}
    return explain_validation(error, kind, hidden=hidden).sentence


def shipped_specimens() -> dict[str, Path]:
    """Return the YAML files that ship with the project, by rig name."""
    folder = Path(str(files("rig_sim"))) / "specimen" / "shipped"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}
