"""Making a campaign's target: a road driven by a vehicle, or a measured file."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from duralab.campaign_file import Campaign, MeasuredRoad, SyntheticRoad, Target
from duralab.errors import InputError
from duralab.rig import Rig
from duralab.signals import Channel, Signals

LEAD_IN_SECONDS: Final = 1.0
"""The vehicle rolls from flat ground onto the road, and off it, in this time."""

SHORTEST_ROAD: Final = 60.0
"""Metres; the synthesis needs a road longer than its longest wave of 50 m."""

LARGEST_TIME_STEP_ERROR: Final = 1e-3
"""How far a time stamp of a file may lie from an even grid, as a share of the step."""

_POTHOLES: Final = 1
"""Number of the seed sequence that places the potholes, beside the road's own."""

ROAD_DRIVES: Final = tuple(
    f"{side}_{what}" for side in ("left", "right") for what in ("height", "slope", "camber", "speed")
)
"""Drives of an axle that plays roads: the effective road under each tyre, and the tyre's speed over it."""

REAR: Final = "rear_"
"""What the drives of a vehicle's rear axle begin with; its front axle's are named as a single axle's."""

VEHICLE_DRIVES: Final = (*ROAD_DRIVES, *(f"{REAR}{name}" for name in ROAD_DRIVES))
"""Drives of a rig with two axles on the same road."""

PlayRoad = Callable[[Signals], Signals]
"""Plays road inputs on the vehicle and returns its responses."""


@dataclass(frozen=True)
class Tyre:
    """Geometry of what rolls over the road, all in metres."""

    track_width: float = 1.51
    radius: float = 0.3265
    contact_length: float = 0.12
    contact_width: float = 0.19
    #: How far a vehicle's rear axle rolls behind its front axle.
    wheelbase: float = 2.8


def describe_target(target: Target) -> str:
    """Return where a target comes from, in words, for the recording and the report."""
    drive = f"driven by {target.vehicle} at {target.speed:g} m/s"
    if target.road is not None:
        road = target.road
        holes = f" with {road.potholes.count} potholes" if road.potholes else ""
        return f"ISO 8608 road of class {road.iso_class}{holes} (seed {road.seed}), {road.duration:g} s {drive}"
    if target.opencrg is not None:
        return f"measured road {target.opencrg.path.name}, {target.opencrg.duration:g} s {drive}"
    return f"file {target.file.name if target.file else ''}"


def make_target(campaign: Campaign, *, rig: Rig, vehicle: Rig | None, play: PlayRoad | None) -> Signals:
    """Make the target of a campaign.

    Parameters
    ----------
    campaign : Campaign
        What was asked for.
    rig : Rig
        The rig that will reproduce the target.
    vehicle : Rig, optional
        The rig that plays roads; needed unless the target is a file.
    play : callable, optional
        Plays road inputs on the vehicle; needed unless the target is a file.

    Returns
    -------
    Signals
        All responses of the rig, in its order and at its sample rate.

    Raises
    ------
    InputError
        The road or the file does not fit the rig.
    """
    target = campaign.target
    if target.file is not None:
        return read_target_file(campaign.folder / target.file, rig=rig, watched=campaign.update.watch)
    if vehicle is None or play is None:
        raise ValueError("A road needs a vehicle that plays it.")
    if vehicle.sample_rate != rig.sample_rate:
        raise InputError(
            f"target.vehicle {vehicle.name!r} runs at {vehicle.sample_rate:g} Hz and rig {rig.name!r} at "
            f"{rig.sample_rate:g} Hz; they must be equal.",
            field="target.vehicle",
        )
    driven = play(road_inputs(campaign, vehicle=vehicle))
    return select_channels(driven, rig=rig, source=f"vehicle {vehicle.name!r}", watched=campaign.update.watch)


def road_inputs(campaign: Campaign, *, vehicle: Rig) -> Signals:
    """Return what the road does to the vehicle's tyres: height, slope, camber and speed, left and right.

    A rig with a rear axle gets the same road there, as much later as it needs for the wheelbase.

    Raises
    ------
    InputError
        The vehicle does not play roads, or the road cannot be made or read.
    """
    import roads

    drives = tuple(channel.name for channel in vehicle.drives)
    if drives not in (ROAD_DRIVES, VEHICLE_DRIVES):
        raise InputError(
            f"target.vehicle is {vehicle.name!r}, whose drives are {', '.join(c.name for c in vehicle.drives)}; a rig "
            f"that plays roads has {', '.join(ROAD_DRIVES)}, and those of a rear axle with {REAR!r} before each.",
            field="target.vehicle",
        )
    target, tyre = campaign.target, Tyre()
    source = target.road or target.opencrg
    if source is None:
        raise ValueError("The target has no road.")
    samples = round(source.duration * vehicle.sample_rate)
    length = max(SHORTEST_ROAD, target.speed * source.duration + 2 * tyre.radius)
    try:
        road = (
            _synthetic(source, length=length, speed=target.speed, tyre=tyre)
            if isinstance(source, SyntheticRoad)
            else _measured(source, folder=campaign.folder, length=length)
        )
        inputs = roads.effective_inputs(
            road,
            speed=target.speed,
            sample_rate=vehicle.sample_rate,
            samples=samples,
            track_width=tyre.track_width,
            tyre_radius=tyre.radius,
            contact_length=tyre.contact_length,
            contact_width=tyre.contact_width,
            lead_in_seconds=LEAD_IN_SECONDS,
            axle_distances=(0.0, tyre.wheelbase) if drives == VEHICLE_DRIVES else (0.0,),
        )
    except ValueError as error:
        section = "target.road" if isinstance(source, SyntheticRoad) else "target.opencrg"
        raise InputError(f"{section}: {error}", field=section) from error
    names = [f"{axle}{name}" for axle in ("", REAR) for name in roads.EFFECTIVE_INPUTS]
    rows: dict[str, np.ndarray] = dict(zip(names[: len(inputs)], inputs, strict=True))
    steady = np.full(samples, target.speed)
    samples_of_all = np.array([rows.get(name, steady) for name in drives])
    return Signals(vehicle.drives, vehicle.sample_rate, samples_of_all)


def _synthetic(road: SyntheticRoad, *, length: float, speed: float, tyre: Tyre):  # noqa: ANN202  (roads is imported late)
    import roads

    surface = roads.iso8608_road(road_class=road.iso_class, length_m=length, seed=road.seed)
    if road.potholes is None:
        return surface
    seed = int(np.random.SeedSequence([road.seed, _POTHOLES]).generate_state(1)[0])
    return roads.add_potholes(
        surface,
        count=road.potholes.count,
        seed=seed,
        lead_in_m=LEAD_IN_SECONDS * speed,
        track_width_m=tyre.track_width,
        length_m=road.potholes.length,
        depth_m=road.potholes.depth,
    )


def _measured(road: MeasuredRoad, *, folder: Path, length: float):  # noqa: ANN202
    import roads

    path = folder / road.path
    try:
        surface = roads.read_opencrg(path)
    except OSError as error:
        raise InputError(
            f"target.opencrg.path is {str(path)!r}, which cannot be read: {error.strerror}; give an OpenCRG file.",
            field="target.opencrg.path",
        ) from error
    return roads.repeat_mirrored(roads.level(surface), length)


def select_channels(signals: Signals, *, rig: Rig, source: str, watched: Collection[str] = ()) -> Signals:
    """Put signals into the order of the rig's responses; every response must be there, in its unit.

    Of one that is `watched` there may be none: its target is silent, and nothing is told relative to it.
    """
    rows = {channel.name: (channel.unit, row) for row, channel in enumerate(signals.channels)}
    wanted = [channel.name for channel in rig.responses]
    missing = [name for name in wanted if name not in rows and name not in watched]
    if missing:
        raise InputError(
            f"target: {source} lacks {', '.join(missing)}; the rig {rig.name!r} needs {', '.join(wanted)}, "
            "but for those in update.watch.",
            field="target",
        )
    for channel in rig.responses:
        if channel.name in rows and rows[channel.name][0] != channel.unit:
            raise InputError(
                f"target: {source} has {channel.name} in {rows[channel.name][0]}; it must be in {channel.unit}.",
                field="target",
            )
    silent = np.zeros(signals.samples.shape[1])
    samples = np.stack([signals.samples[rows[name][1]] if name in rows else silent for name in wanted])
    return Signals(rig.responses, signals.sample_rate, samples)


def read_target_file(path: Path, *, rig: Rig, watched: Collection[str] = ()) -> Signals:
    """Read a target from a CSV file: a column 'time [s]', then one column '<response> [<unit>]' for each response.

    Those that are `watched` may be missing.

    Raises
    ------
    InputError
        No such file, no samples, a column is missing, a value is no finite number, or another sample rate.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            lines = [line for line in csv.reader(stream) if line]
    except OSError as error:
        raise InputError(
            f"target.file is {str(path)!r}, which cannot be read: {error.strerror}.", field="target.file"
        ) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"target.file {path} is not CSV text: {error}.", field="target.file") from error
    if len(lines) < 3:
        raise InputError(
            f"target.file {path} holds {max(0, len(lines) - 1)} samples; it needs a header and 2 samples or more.",
            field="target.file",
        )
    channels = [_column(path, heading) for heading in lines[0]]
    if (channels[0].name, channels[0].unit) != ("time", "s"):
        raise InputError(f"target.file {path} starts with {lines[0][0]!r}; it must be 'time [s]'.", field="target.file")
    values = _numbers(path, lines)
    _require_rate(path, values[0], rig.sample_rate)
    given = Signals(tuple(channels[1:]), rig.sample_rate, values[1:])
    return select_channels(given, rig=rig, source=f"file {path}", watched=watched)


def _column(path: Path, heading: str) -> Channel:
    name, opened, unit = heading.strip().partition("[")
    if not opened or not unit.endswith("]"):
        raise InputError(
            f"target.file {path} has the column {heading!r}; it must name a unit, e.g. 'left_vertical [N]'.",
            field="target.file",
        )
    return Channel(name=name.strip(), unit=unit[:-1].strip())


def _numbers(path: Path, lines: list[list[str]]) -> np.ndarray:
    values = np.empty((len(lines[0]), len(lines) - 1))
    for index, line in enumerate(lines[1:]):
        try:
            values[:, index] = [float(cell) for cell in line]
        except ValueError as error:
            raise InputError(
                f"target.file {path}, line {index + 2}: {error}; {len(lines[0])} numbers are needed.",
                field="target.file",
            ) from error
    if not np.isfinite(values).all():
        row, index = np.argwhere(~np.isfinite(values))[0]
        raise InputError(
            f"target.file {path}, line {index + 2}: {lines[0][row].strip()} is {values[row, index]}; every value must "
            "be finite.",
            field="target.file",
        )
    return values


def _require_rate(path: Path, time: np.ndarray, sample_rate: float) -> None:
    steps = np.diff(time)
    step = float(np.median(steps))
    if not (math.isfinite(step) and step > 0 and np.ptp(steps) <= 2 * LARGEST_TIME_STEP_ERROR * step):
        raise InputError(
            f"target.file {path} has time steps from {steps.min():g} to {steps.max():g} s; they must be equal.",
            field="target.file",
        )
    if abs(step * sample_rate - 1) > LARGEST_TIME_STEP_ERROR:
        raise InputError(
            f"target.file {path} is sampled at {1 / step:g} Hz; the rig plays {sample_rate:g} Hz only, so resample it.",
            field="target.file",
        )
