"""Making of a campaign's target: a vehicle's responses to a road, or a measured file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from duralab.campaign import Campaign, MeasuredRoad, SyntheticRoad, Target
from duralab.data import LARGEST_RATE_ERROR, Rig, Signals
from duralab.errors import InputError
from duralab.target.editing import EditedTarget, edit_signals
from duralab.target.measured import map_channels, read_target_file
from duralab_settings import require_regular

LEAD_IN_SECONDS: Final = 1.0
"""Duration of the transition from flat ground to the road, and back."""


SHORTEST_ROAD: Final = 60.0
"""Shortest road in metres; the synthesis needs a road longer than its longest wave of 50 m."""

_POTHOLES: Final = 1
"""Number of the seed sequence for the positions of the potholes, separate from the road's."""

ROAD_DRIVES: Final = tuple(
    f"{side}_{what}" for side in ("left", "right") for what in ("height", "slope", "camber", "speed")
)
"""Drives of an axle that plays roads: the effective road under each tyre, and the tyre's speed over it."""

REAR: Final = "rear_"
"""Prefix of the drives of a vehicle's rear axle; its front axle has the names of a single axle."""

VEHICLE_DRIVES: Final = (*ROAD_DRIVES, *(f"{REAR}{name}" for name in ROAD_DRIVES))
"""Drives of a rig with two axles on the same road."""

PlayRoad = Callable[[Signals], Signals]
"""Function that plays road inputs on the vehicle and returns its responses."""


@dataclass(frozen=True)
class Tyre:
    """Geometry of tyres and axles, in metres."""

    track_width: float = 1.51
    radius: float = 0.3265
    contact_length: float = 0.12
    contact_width: float = 0.19
    #: Distance of a vehicle's rear axle from its front axle.
    wheelbase: float = 2.8


def describe_target(target: Target) -> str:
    """Return the source of a target as text, for the recording and the report.

    Parameters
    ----------
    target : Target
        Section `target` of a campaign file.

    Returns
    -------
    str
        Phrase without a full stop.
    """
    drive = f"driven by {target.vehicle} at {target.speed:g} m/s"
    if target.road is not None:
        road = target.road
        holes = f" with {road.potholes.count} pothole{'' if road.potholes.count == 1 else 's'}" if road.potholes else ""
        return f"ISO 8608 road of class {road.iso_class}{holes} (seed {road.seed}), {road.duration:g} s {drive}"
    if target.opencrg is not None:
        return f"measured road {target.opencrg.path.name}, {target.opencrg.duration:g} s {drive}"
    return f"file {target.file.name if target.file else ''}"


def make_target(campaign: Campaign, *, rig: Rig, vehicle: Rig | None, play: PlayRoad | None) -> EditedTarget:
    """Make the target of a campaign.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the target section.
    rig : Rig
        Rig that will reproduce the target.
    vehicle : Rig, optional
        Rig that plays roads; needed unless the target is a file.
    play : callable, optional
        Function that plays road inputs on the vehicle; needed unless the target is a file.

    Returns
    -------
    EditedTarget
        All responses of the rig, in its order and at its sample rate, and a record of each step, beginning with the
        reading of a file.

    Raises
    ------
    InputError
        The road or the file does not fit the rig, or a step of editing does not fit them.
    """
    source = _source(campaign, rig=rig, vehicle=vehicle, play=play)
    edited = edit_signals(source.signals, campaign.target.edit)
    require_playable(edited.signals, rig=rig)
    return EditedTarget(
        signals=replace(edited.signals, sample_rate=rig.sample_rate), records=(*source.records, *edited.records)
    )


def _source(campaign: Campaign, *, rig: Rig, vehicle: Rig | None, play: PlayRoad | None) -> EditedTarget:
    target, watched = campaign.target, campaign.update.watch
    if target.file is not None:
        return read_target_file(
            campaign.folder / target.file,
            rig=rig,
            channels=target.channels,
            watched=watched,
            calculated=target.calculated,
        )
    if vehicle is None or play is None:
        raise ValueError("A road needs a vehicle that plays it.")
    if vehicle.sample_rate != rig.sample_rate:
        raise InputError(
            f"target.vehicle {vehicle.name!r} runs at {vehicle.sample_rate:g} Hz and rig {rig.name!r} at "
            f"{rig.sample_rate:g} Hz; they must be equal.",
            field="target.vehicle",
        )
    driven = play(road_inputs(campaign, vehicle=vehicle))
    return EditedTarget(
        map_channels(
            driven,
            rig=rig,
            watched=watched,
            source=f"vehicle {vehicle.name!r}",
            remedy="take another vehicle, or watch the response (update.watch)",
        )
    )


def require_playable(signals: Signals, *, rig: Rig) -> None:
    """Refuse a target whose sample rate or length the rig cannot play; raises InputError.

    Parameters
    ----------
    signals : Signals
        Target.
    rig : Rig
        Rig that reproduces it.

    Raises
    ------
    InputError
        The sample rate is not the rig's, or the target is longer than the rig plays.
    """
    if abs(signals.sample_rate / rig.sample_rate - 1) > LARGEST_RATE_ERROR:
        raise InputError(
            f"target is sampled at {signals.sample_rate:g} Hz; rig {rig.name!r} plays {rig.sample_rate:g} Hz only, so "
            f"end target.edit with 'resample: {{rate: {rig.sample_rate:g}}}'.",
            field="target.edit",
        )
    if signals.duration > rig.longest_drive_seconds:
        raise InputError(
            f"target lasts {signals.duration:g} s; rig {rig.name!r} plays {rig.longest_drive_seconds:g} s at most, so "
            "cut or shorten it in target.edit.",
            field="target.edit",
        )


def road_inputs(campaign: Campaign, *, vehicle: Rig) -> Signals:
    """Return the road inputs of the vehicle's tyres: height, slope, camber and speed, left and right.

    A rear axle gets the same road, delayed by the time for the wheelbase.
    """
    import duralab_roads

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
        inputs = duralab_roads.effective_inputs(
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
    names = [f"{axle}{name}" for axle in ("", REAR) for name in duralab_roads.EFFECTIVE_INPUTS]
    rows: dict[str, np.ndarray] = dict(zip(names[: len(inputs)], inputs, strict=True))
    steady = np.full(samples, target.speed)
    samples_of_all = np.array([rows.get(name, steady) for name in drives])
    return Signals(vehicle.drives, vehicle.sample_rate, samples_of_all)


def _synthetic(road: SyntheticRoad, *, length: float, speed: float, tyre: Tyre):  # noqa: ANN202  (roads is imported late)
    import duralab_roads

    surface = duralab_roads.iso8608_road(road_class=road.iso_class, length_m=length, seed=road.seed)
    if road.potholes is None:
        return surface
    seed = int(np.random.SeedSequence([road.seed, _POTHOLES]).generate_state(1)[0])
    return duralab_roads.add_potholes(
        surface,
        count=road.potholes.count,
        seed=seed,
        lead_in_m=LEAD_IN_SECONDS * speed,
        track_width_m=tyre.track_width,
        length_m=road.potholes.length,
        depth_m=road.potholes.depth,
    )


def _measured(road: MeasuredRoad, *, folder: Path, length: float):  # noqa: ANN202
    import duralab_roads

    path = folder / road.path
    try:
        require_regular(path)
        surface = duralab_roads.read_opencrg(path)
    except OSError as error:
        raise InputError(
            f"target.opencrg.path is {str(path)!r}, which cannot be read: {error.strerror}; give an OpenCRG file.",
            field="target.opencrg.path",
        ) from error
    return duralab_roads.repeat_mirrored(duralab_roads.level(surface), length)
