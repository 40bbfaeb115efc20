"""Map between the channels of a rig in the lab and those of its controller, from YAML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from duralab_drive_files.errors import DriveFileError
from duralab_drive_files.rpc3_header import DataType
from duralab_drive_files.time_history import TimeHistory
from duralab_drive_files.wheel_force import COMPONENTS, WheelForceConvention, moments_about, wheel_force_signs
from duralab_gateway import ChannelTable
from duralab_proto.arrays import to_array
from duralab_proto.channels import UNIT_OF_KIND
from duralab_proto.keys import check_rig
from duralab_proto.v1 import array_pb2, rig_pb2
from duralab_settings import (
    Positive,
    Section,
    UnitError,
    YamlError,
    explain_validation,
    parse_yaml,
    read_yaml_text,
    unit_conversion,
)

_KINDS: Final = {
    array_pb2.ChannelKind.Name(kind).removeprefix("CHANNEL_KIND_").lower(): (kind, unit)
    for kind, unit in UNIT_OF_KIND.items()
}
"""Kind of a channel in the contract and its SI unit, by its name in a map."""

Name = Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$", max_length=120)]
# Characters and length of a name that an RPC III header can hold.
Descriptor = Annotated[str, Field(pattern=r"^[ -~\u00a0-\u00ff]*[!-~\u00a1-\u00ff][ -~\u00a0-\u00ff]*$", max_length=95)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Sign = Annotated[Literal[1, -1], Field(description="1, or -1 where the controller's axis points the other way.")]


class _ChannelSection(Section):
    """Mapping of a drive or a response; limits are in the controller's unit."""

    channel: Descriptor = Field(description="Name of the controller's channel, as in its files.")
    kind: str = Field(description=f"What it is: {', '.join(_KINDS)}.")
    unit: str = Field(description="The controller's unit of it.")
    factor: Positive = Field(default=1.0, description="Controller's value over that of the lab, in the same unit.")
    offset: Finite = Field(default=0.0, description="Controller's value where the lab's is 0, in its unit.")
    sign: Sign = 1
    minimum: Finite = Field(description="Smallest value, in the controller's unit.")
    maximum: Finite = Field(description="Largest value, in the controller's unit.")
    label: str = Field(default="", description="What it is and where it acts.")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.kind not in _KINDS:
            raise ValueError(f"kind is {self.kind!r}; {', '.join(_KINDS)} are known")
        if not self.minimum < self.maximum:
            raise ValueError(f"minimum is {self.minimum:g} and maximum {self.maximum:g}; minimum must be below")
        return self


class _DriveSection(_ChannelSection):
    slew_limit: Positive | None = Field(default=None, description="Largest rate, in the controller's unit per second.")
    actuator_speed: Positive | None = Field(
        default=None, description="Speed with the valve at its stop, in the controller's unit per second."
    )
    full_scale: Positive | None = Field(
        default=None, description="Full scale of the control mode, in the controller's unit; the larger limit."
    )
    recorded_command: Descriptor | None = Field(
        default=None, description="Channel of the response file in which the controller records this command."
    )
    holds_static: bool = Field(default=False, description="Whether any constant value is held, as a stroke is.")

    @model_validator(mode="after")
    def _check_full_scale(self) -> Self:
        reach = max(abs(self.minimum), abs(self.maximum))
        if self.full_scale is not None and self.full_scale < reach:
            raise ValueError(
                f"full_scale is {self.full_scale:g} {self.unit}, and the limits reach {reach:g} {self.unit}; give the "
                "full scale of the control mode, or lower the limits"
            )
        return self


class _ResponseSection(_ChannelSection):
    ac_coupled: bool = Field(default=False, description="Whether a constant value is not measured.")


class _WheelForceSection(Section):
    """Wheel-force transducer: its channels become responses in the axes of ISO 8855."""

    convention: WheelForceConvention = Field(strict=False, description="Axes of the transducer.")
    channels: dict[Literal["fx", "fy", "fz", "mx", "my", "mz"], Descriptor] = Field(min_length=1)
    force_unit: str = Field(default="N", description="The controller's unit of the forces.")
    moment_unit: str = Field(default="N*m", description="The controller's unit of the moments.")
    force_range: Positive = Field(description="Largest magnitude of the forces, in the controller's unit.")
    moment_range: Positive | None = Field(default=None, description="Largest magnitude of the moments, likewise.")
    offset: tuple[Finite, Finite, Finite] = Field(
        default=(0.0, 0.0, 0.0),
        strict=False,
        description="From the centre to the point of the moments, m.",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if any(name in self.channels for name in COMPONENTS[3:]) and self.moment_range is None:
            raise ValueError("moment_range is missing; give it beside the moments")
        if any(self.offset) and set(self.channels) != set(COMPONENTS):
            raise ValueError(f"offset needs all of {', '.join(COMPONENTS)}; give their channels, or no offset")
        return self


class _MapSection(Section):
    rig: str = Field(description="Name of the rig in the lab.")
    specimen: str = Field(default="", description="What is mounted on it.")
    controller: str = Field(default="", description="The controller and its station.")
    sample_rate: Positive = Field(description="Sample rate in the lab, Hz.")
    controller_rate: Positive | None = Field(default=None, description="Sample rate of the drive file; the lab's, Hz.")
    longest_drive: Positive = Field(default=3600.0, description="Longest drive, s.")
    lead: float = Field(default=2.0, gt=0.0, le=60.0, description="Length of the ways in and out in the file, s.")
    drive_has_offset: bool = Field(default=False, description="Whether the controller makes these ways instead.")
    numbers: DataType = Field(default=DataType.SHORT_INTEGER, strict=False, description="How samples are stored.")
    exchange: str = Field(default="exchange", description="Folder of outbox and inbox, relative to the map.")
    drives: dict[Name, _DriveSection] = Field(min_length=1)
    responses: dict[Name, _ResponseSection] = Field(default_factory=dict)
    wheel_forces: dict[Name, _WheelForceSection] = Field(default_factory=dict)
    channels: ChannelTable = Field(
        default_factory=ChannelTable, description="Sensors and calculated responses, as of any gateway."
    )


@dataclass(frozen=True)
class MappedChannel:
    """Drive or response, and the controller's channel for it.

    Controller's value = `sign` · `factor` · (value in `controller_unit`) + `offset`.

    Parameters
    ----------
    name : str
        Name in the lab.
    kind : str
        Kind as in the contract, e.g. "displacement".
    unit : str
        SI unit in the lab.
    controller_channel : str
        Name in the controller's files.
    controller_unit : str
        Unit in the controller's files.
    factor, offset : float
        Coefficients of the formula above; the offset in `controller_unit`.
    sign : int
        Sign of the formula, 1 or -1.
    minimum, maximum : float
        Allowed range, in `unit`.
    slew_limit : float
        Largest rate, in `unit` per second; 0 if none is stated.
    actuator_speed : float
        For a drive: speed of the actuator with its valve at its stop, in `unit` per second; 0 if not stated.
    stated_full_scale : float
        Full scale of the control mode, in `controller_unit`; 0 if it is the larger limit.
    recorded_command : str
        For a drive: the channel of the response file with its recorded command; empty if there is none.
    label : str
        Description and location of the channel.
    holds_static, ac_coupled : bool
        Properties as in the contract.
    """

    name: str
    kind: str
    unit: str
    controller_channel: str
    controller_unit: str
    factor: float = 1.0
    offset: float = 0.0
    sign: int = 1
    minimum: float = -np.inf
    maximum: float = np.inf
    slew_limit: float = 0.0
    actuator_speed: float = 0.0
    stated_full_scale: float = 0.0
    recorded_command: str = ""
    label: str = ""
    holds_static: bool = False
    ac_coupled: bool = False

    @property
    def scale(self) -> float:
        """Change of the controller's value over that of the lab's."""
        return self.sign * self.factor * unit_conversion(self.unit, self.controller_unit, self.name)[0]

    @property
    def full_scale(self) -> float:
        """Largest magnitude of the channel in a file, in the controller's unit; not its peak."""
        if self.stated_full_scale:
            return self.stated_full_scale
        ends = (self.scale * self.minimum + self.offset, self.scale * self.maximum + self.offset)
        return max(map(abs, ends))

    def to_message(self) -> array_pb2.Channel:
        """Return it as a message of the contract."""
        return array_pb2.Channel(
            name=self.name,
            unit=self.unit,
            kind=_KINDS[self.kind][0],
            minimum=self.minimum,
            maximum=self.maximum,
            slew_limit=self.slew_limit,
            actuator_speed=self.actuator_speed,
            label=self.label,
            holds_static=self.holds_static,
            ac_coupled=self.ac_coupled,
        )


@dataclass(frozen=True)
class ControllerMap:
    """Layout of a rig's drives and responses in the files of its controller.

    Parameters
    ----------
    rig, specimen, controller : str
        Name in the lab, mounted specimen, and controller.
    sample_rate, controller_rate : float
        Sample rates in the lab and of the drive file, in Hz.
    longest_drive : float
        Longest drive in s.
    lead_seconds : float
        Length in s of the lead from rest to the first sample, and back from the last, in the file.
    drive_has_offset : bool
        Whether the controller makes the leads, so that the file has none.
    numbers : DataType
        Storage type of samples.
    exchange : Path
        Folder of outbox and inbox.
    drives, responses : tuple of MappedChannel
        Channels in the order of the lab; responses from wheel-force transducers come last.
    channels : ChannelTable
        Sensors and calculated responses.
    wheels : tuple of (tuple of int, tuple of float)
        Rows of the six responses of each transducer whose moments are about another point, and its offset in m.
    """

    rig: str
    specimen: str
    controller: str
    sample_rate: float
    controller_rate: float
    longest_drive: float
    lead_seconds: float
    drive_has_offset: bool
    numbers: DataType
    exchange: Path
    drives: tuple[MappedChannel, ...]
    responses: tuple[MappedChannel, ...]
    channels: ChannelTable = field(default_factory=ChannelTable)
    wheels: tuple[tuple[tuple[int, ...], tuple[float, float, float]], ...] = ()

    @property
    def recorded_commands(self) -> dict[str, str]:
        """Channel of the response file with the recorded command, by the drive's name; only recorded ones."""
        return {drive.name: drive.recorded_command for drive in self.drives if drive.recorded_command}

    def description(self) -> rig_pb2.RigDescription:
        """Return the rig's description as a message of the contract.

        Returns
        -------
        rig_pb2.RigDescription
            Description without sensors and calculated responses, which `channels.complete` adds, and without version
            and hash.
        """
        return rig_pb2.RigDescription(
            rig=self.rig,
            specimen=self.specimen,
            engine=self.controller,
            sample_rate=self.sample_rate,
            drives=[drive.to_message() for drive in self.drives],
            responses=[response.to_message() for response in self.responses],
            longest_drive_seconds=self.longest_drive,
            static_response=to_array(np.zeros(len(self.responses))),
            publishes_after_run=True,
        )

    def drives_to_controller(self, drive: np.ndarray) -> np.ndarray:
        """Return a drive in the controller's units.

        Parameters
        ----------
        drive : ndarray, shape (drives, samples)
            Drive in the units of the lab.

        Returns
        -------
        ndarray, shape (drives, samples)
            Drive with the controller's signs and offsets.
        """
        return _to_controller(self.drives, drive)

    def drives_from_controller(self, history: TimeHistory) -> np.ndarray:
        """Return the drive in a drive file, in the units of the lab.

        Parameters
        ----------
        history : TimeHistory
            Drive file, at any sample rate.

        Returns
        -------
        ndarray, shape (drives, samples)
            Drive, in the order of `drives`.

        Raises
        ------
        DriveFileError
            As for `responses_from_controller`.
        """
        return _rows(history, self.drives)

    def commands_from_controller(self, history: TimeHistory) -> dict[str, np.ndarray]:
        """Return the recorded commands in the units of the lab.

        Parameters
        ----------
        history : TimeHistory
            Response file.

        Returns
        -------
        dict of str to ndarray, shape (samples)
            Commands by the drive's name; only those that the map and the file have.

        Raises
        ------
        DriveFileError
            If a unit of the file does not convert, or a channel occurs in it twice.
        """
        there = [drive for drive in self.drives if drive.recorded_command in _labels(history)]
        return {drive.name: _row(history, drive.recorded_command, drive) for drive in there}

    def responses_from_controller(self, history: TimeHistory) -> np.ndarray:
        """Return the measured responses of a file in the units of the lab.

        Parameters
        ----------
        history : TimeHistory
            Response file, at any sample rate.

        Returns
        -------
        ndarray, shape (responses, samples)
            Responses, in the order of `responses`.

        Raises
        ------
        DriveFileError
            If a channel is missing or occurs twice, or its unit does not convert; all missing ones are named.
        """
        rows = _rows(history, self.responses)
        for wheel, offset in self.wheels:
            forces, moments = list(wheel[:3]), list(wheel[3:])
            rows[moments] = moments_about(rows[forces], rows[moments], np.array(offset))
        return rows

    def responses_to_controller(self, response: np.ndarray) -> np.ndarray:
        """Return responses as the controller measures them; the reverse of `responses_from_controller`.

        Parameters
        ----------
        response : ndarray, shape (responses, samples)
            Responses in the units of the lab.

        Returns
        -------
        ndarray, shape (responses, samples)
            Responses in the controller's units, signs and reference points.
        """
        rows = np.array(response, dtype=np.float64)
        for wheel, offset in self.wheels:
            forces, moments = list(wheel[:3]), list(wheel[3:])
            rows[moments] = moments_about(rows[forces], rows[moments], -np.array(offset))
        return _to_controller(self.responses, rows)


def _to_controller(channels: Sequence[MappedChannel], samples: np.ndarray) -> np.ndarray:
    scales = np.array([[channel.scale] for channel in channels])
    return samples * scales + np.array([[channel.offset] for channel in channels])


def _labels(history: TimeHistory) -> list[str]:
    return [label.strip() for label in history.labels or history.names]


def _rows(history: TimeHistory, channels: Sequence[MappedChannel]) -> np.ndarray:
    labels = _labels(history)
    if missing := [each.controller_channel for each in channels if each.controller_channel not in labels]:
        raise DriveFileError(
            f"it lacks the channels {', '.join(missing)}; it has {', '.join(labels)}, and all that the map names are "
            "needed."
        )
    return np.stack([_row(history, each.controller_channel, each) for each in channels])


def _row(history: TimeHistory, name: str, channel: MappedChannel) -> np.ndarray:
    labels = _labels(history)
    if labels.count(name) > 1:
        raise DriveFileError(f"the channel {name!r} is in it {labels.count(name)} times; give each its own name.")
    index = labels.index(name)
    # A channel without a unit in the file has that of the map.
    unit = history.units[index].strip() or channel.controller_unit
    try:
        factor, offset = unit_conversion(unit, channel.controller_unit, f"the channel {name!r}")
    except UnitError as error:
        raise DriveFileError(f"{str(error).rstrip('.')}; correct the map or the controller's unit.") from error
    # Each row in one operation: a long file is not copied more often than needed.
    row = history.samples[index]
    return ((row * factor + offset if (factor, offset) != (1.0, 0.0) else row) - channel.offset) / channel.scale


def read_controller_map(path: Path) -> ControllerMap:
    """Read the map of a rig's controller.

    Parameters
    ----------
    path : Path
        YAML file.

    Returns
    -------
    ControllerMap
        Checked map: one-to-one, with units that convert.

    Raises
    ------
    DriveFileError
        If the file cannot be read or a value is not allowed; one sentence.
    """
    try:
        content = parse_yaml(read_yaml_text(path))
        section = _MapSection.model_validate({} if content is None else content)
    except OSError as error:
        raise DriveFileError(f"it cannot be read ({error.strerror}); give an existing map.", path=path) from error
    except UnicodeDecodeError as error:
        raise DriveFileError("it is not UTF-8 text.", path=path) from error
    except YamlError as error:
        raise DriveFileError(f"it is not YAML: {error}; correct it there.", path=path) from error
    except ValidationError as error:
        raise DriveFileError(explain_validation(error, _MapSection).sentence, path=path) from error
    try:
        return _compiled(section, path.parent)
    except DriveFileError as error:
        raise DriveFileError(error.sentence, path=path) from error
    # Errors of units, names, sensors and calculated channels.
    except ValueError as error:
        raise DriveFileError(str(error), path=path) from error


def _compiled(section: _MapSection, folder: Path) -> ControllerMap:
    check_rig(section.rig)
    drives = tuple(
        _mapped(
            name,
            drive,
            slew_limit=drive.slew_limit or 0.0,
            actuator_speed=drive.actuator_speed or 0.0,
            stated_full_scale=drive.full_scale or 0.0,
            recorded_command=drive.recorded_command or "",
            holds_static=drive.holds_static,
        )
        for name, drive in section.drives.items()
    )
    responses = [_mapped(name, each, ac_coupled=each.ac_coupled) for name, each in section.responses.items()]
    wheels: list[tuple[tuple[int, ...], tuple[float, float, float]]] = []
    for name, wheel in section.wheel_forces.items():
        if any(wheel.offset):
            wheels.append((tuple(range(len(responses), len(responses) + 6)), wheel.offset))
        responses += _wheel_channels(name, wheel)
    _require_one_to_one("drives", drives, [drive.controller_channel for drive in drives])
    recorded = [drive.recorded_command for drive in drives if drive.recorded_command]
    _require_one_to_one("responses", responses, [each.controller_channel for each in responses] + recorded)
    for drive in drives:
        if not drive.minimum <= 0.0 <= drive.maximum:
            raise DriveFileError(
                f"{drive.name} goes from {drive.minimum:g} to {drive.maximum:g} {drive.unit} in the lab; a rig rests "
                "at 0, which its limits and its offset must allow."
            )
    if not responses:
        raise DriveFileError("responses and wheel_forces are empty; map one response or more.")
    found = ControllerMap(
        rig=section.rig,
        specimen=section.specimen,
        controller=section.controller,
        sample_rate=section.sample_rate,
        controller_rate=section.controller_rate or section.sample_rate,
        longest_drive=section.longest_drive,
        lead_seconds=section.lead,
        drive_has_offset=section.drive_has_offset,
        numbers=section.numbers,
        exchange=folder / section.exchange,
        drives=drives,
        responses=tuple(responses),
        channels=section.channels,
        wheels=tuple(wheels),
    )
    found.channels.complete(found.description(), today=date.today())
    return found


def _mapped(
    name: str, section: _ChannelSection, *, slew_limit: float = 0.0, actuator_speed: float = 0.0, **more: Any
) -> MappedChannel:
    unit = _KINDS[section.kind][1]
    factor, shift = unit_conversion(section.unit, unit, name)
    if shift:
        raise DriveFileError(f"{name} is in {section.unit!r}, whose zero is not that of {unit!r}; take another unit.")
    # Change of the lab's value over that of the controller's.
    scale = factor * section.sign / section.factor
    ends = sorted((section.minimum - section.offset, section.maximum - section.offset), key=lambda end: scale * end)
    return MappedChannel(
        name=name,
        kind=section.kind,
        unit=unit,
        controller_channel=section.channel.strip(),
        controller_unit=section.unit,
        factor=section.factor,
        offset=section.offset,
        sign=section.sign,
        minimum=scale * ends[0],
        maximum=scale * ends[1],
        slew_limit=slew_limit * abs(scale),
        actuator_speed=actuator_speed * abs(scale),
        label=section.label,
        **more,
    )


def _wheel_channels(wheel: str, section: _WheelForceSection) -> list[MappedChannel]:
    signs = dict(zip(COMPONENTS, wheel_force_signs(section.convention), strict=True))
    channels = []
    for component in COMPONENTS:
        if component not in section.channels:
            continue
        is_force = component[0] == "f"
        kind = "force" if is_force else "moment"
        unit = _KINDS[kind][1]
        controller_unit = section.force_unit if is_force else section.moment_unit
        name = f"{wheel}_{component}"
        factor, _ = unit_conversion(controller_unit, unit, name)
        reach = factor * (section.force_range if is_force else section.moment_range or 0.0)
        channels.append(
            MappedChannel(
                name=name,
                kind=kind,
                unit=unit,
                controller_channel=section.channels[component].strip(),
                controller_unit=controller_unit,
                sign=signs[component],
                minimum=-reach,
                maximum=reach,
                label=f"{component.capitalize()} of the {wheel} wheel, ISO 8855",
            )
        )
    return channels


def _require_one_to_one(what: str, channels: Sequence[MappedChannel], names: Sequence[str]) -> None:
    """Refuse a controller's channel that is mapped twice, and a name of the lab that is given twice."""
    for given in (names, [channel.name for channel in channels]):
        if twice := sorted({name for name in given if list(given).count(name) > 1}):
            raise DriveFileError(
                f"{what} name {', '.join(twice)} more than once; the map must be one-to-one, give each its own channel."
            )
