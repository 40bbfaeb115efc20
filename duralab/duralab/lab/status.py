"""State of a lab: services, rigs, running campaigns and recordings."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeVar

from google.protobuf.message import Message

from duralab.data import IterationTable, RigMode, RigState
from duralab.lab.client import recordings_key
from duralab.lab.progress import ENDED
from duralab_bus import Bus, FaultError, FigureKind
from duralab_proto.keys import MAIN_INSTANCE
from duralab_proto.v1 import health_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2

SILENCE_SECONDS: Final = 3.0
"""A service that gives no sign of life for so long is reported as silent."""

MessageT = TypeVar("MessageT", bound=Message)

_KINDS: Final = {
    health_pb2.FIGURE_KIND_GAUGE: FigureKind.GAUGE,
    health_pb2.FIGURE_KIND_COUNTER: FigureKind.COUNTER,
}


@dataclass(frozen=True)
class Figure:
    """One figure of a service in SI units; its name and labels, e.g. {"rig": "front_axle"}, are those of Prometheus."""

    name: str
    what: str
    kind: FigureKind
    labels: Mapping[str, str]
    value: float


@dataclass(frozen=True)
class ServiceHealth:
    """Health of one instance of a service: of a rig's name, or "main".

    `up_seconds`: Time of its process on the bus; not a number where it does not tell. `figures`: Rigs of one process
    tell the same. `trouble`: Why it does not tell, in one sentence; empty where it does.
    """

    service: str
    instance: str
    up_seconds: float = float("nan")
    figures: tuple[Figure, ...] = field(default=(), repr=False)
    trouble: str = ""

    def value(self, name: str, **labels: str) -> float | None:
        """Return the sum of a figure's values over those with these labels; None where it does not tell of it."""
        found = [
            figure.value
            for figure in self.figures
            if figure.name == name and all(figure.labels.get(label) == value for label, value in labels.items())
        ]
        return sum(found) if found else None


def health_of(bus: Bus) -> list[ServiceHealth]:
    """Ask everybody on the bus how they are."""
    return [_asked(bus, service, instance) for service, instance in sorted(bus.discover())]


def _asked(bus: Bus, service: str, instance: str) -> ServiceHealth:
    try:
        health = _ask(bus, bus.keys.health(service, instance), health_pb2.HealthRequest(), health_pb2.Health)
    except FaultError as fault:
        unknown = fault.code == query_pb2.FAULT_CODE_UNIMPLEMENTED
        trouble = "It tells no figures: its kind of service does not know the question." if unknown else fault.message
        return ServiceHealth(service, instance, trouble=trouble)
    return ServiceHealth(
        service,
        instance,
        up_seconds=health.up_seconds,
        figures=tuple(
            Figure(
                name=family.name,
                what=family.what,
                kind=_KINDS.get(family.kind, FigureKind.GAUGE),
                labels=dict(zip(family.labels, value.labels, strict=False)),
                value=value.value,
            )
            for family in health.figures
            for value in family.values
        ),
    )


SERVICES: Final = ("rig_sim", "identifier", "iterator", "recorder")
"""What a whole lab has; of the first, one instance for each rig."""


@dataclass(frozen=True)
class CampaignUnderWay:
    """A campaign that has not ended.

    `error`: Overall one of its last playback, None before the first. `proposal`: Number of the proposal that it waits
    with for a decision; 0 where it does not wait.
    """

    id: str
    rig: str
    activity: str
    fraction: float
    remaining_seconds: float
    playbacks: int
    error: float | None
    proposal: int = 0


@dataclass(frozen=True)
class RecorderStatus:
    """Content of a recorder; `free_bytes` is None if its disk belongs to another machine.

    `missing_blocks`: Signal blocks that it knows of and does not hold yet; of an ended run, what is lost. `waiting`:
    Why it cannot write now; empty where it can.
    """

    recordings: int
    open_recordings: int
    bytes: int
    missing_blocks: int
    waiting: str
    free_bytes: int | None


@dataclass(frozen=True)
class LabStatus:
    """State of a lab; `missing` names the services that do not run, and without a recorder `recorder` is None."""

    missing: tuple[str, ...]
    services: tuple[ServiceHealth, ...]
    rigs: tuple[RigState, ...]
    campaigns: tuple[CampaignUnderWay, ...]
    recorder: RecorderStatus | None

    @property
    def whole(self) -> bool:
        """Whether every service is there and the recorder can write."""
        return not self.missing and (self.recorder is None or not self.recorder.waiting)


def lab_status(bus: Bus, *, recordings: Path | None = None) -> LabStatus:
    """Ask everyone of a lab how they are; `recordings` is the recorder's folder, where it is on this machine."""
    live = bus.discover()
    there = {service for service, _ in live}
    rigs = sorted(instance for service, instance in live if service == "rig_sim")
    held = _held(bus) if ("recorder", MAIN_INSTANCE) in live else None
    return LabStatus(
        missing=tuple(name for name in SERVICES if name not in there),
        services=tuple(health_of(bus)),
        rigs=tuple(_rig(bus, name) for name in rigs),
        campaigns=_campaigns(bus, held or []) if "iterator" in there else (),
        recorder=None if held is None else _recorder(held, recordings),
    )


def _rig(bus: Bus, name: str) -> RigState:
    try:
        state = _ask(bus, bus.keys.rig_state(name), rig_pb2.StateRequest(), rig_pb2.RigState)
        # Latched and not at rest: either on its way down, or on its way to the end of a run that cannot be stopped.
        goes_on = bool(state.mode == rig_pb2.RIG_MODE_INTERLOCKED and state.run)
        if goes_on:
            key, request = bus.keys.rig_description(name), rig_pb2.DescriptionRequest()
            goes_on = _ask(bus, key, request, rig_pb2.RigDescription).cannot_be_stopped
    except FaultError as fault:
        return RigState(name, RigMode.UNKNOWN, fault.message, run="", fraction=0.0)
    return RigState.from_message(state, goes_on=goes_on)


def _ask(bus: Bus, key: str, request: Message, kind: type[MessageT]) -> MessageT:
    return bus.query(key, request, kind, silence_seconds=SILENCE_SECONDS)


def _held(bus: Bus) -> list[recorder_pb2.RecordingInfo] | None:
    try:
        request = recorder_pb2.ListRecordingsRequest()
        return list(_ask(bus, recordings_key(bus), request, recorder_pb2.RecordingList).recordings)
    except FaultError:
        return None


def _campaigns(bus: Bus, held: list[recorder_pb2.RecordingInfo]) -> tuple[CampaignUnderWay, ...]:
    found = []
    for information in held:
        if information.closed:
            continue
        # The iterator knows no recording that was broken off before it began; that one waits for `duralab resume`.
        with suppress(FaultError):
            key = bus.keys.campaign(information.recording)
            status = _ask(bus, key, iterator_pb2.CampaignRequest(), iterator_pb2.CampaignStatus)
            if status.phase not in ENDED:
                found.append(_under_way(status, rig=information.rig))
    return tuple(found)


def _under_way(status: iterator_pb2.CampaignStatus, *, rig: str) -> CampaignUnderWay:
    table = IterationTable.from_status(status) if status.iterations else None
    return CampaignUnderWay(
        id=status.id,
        rig=rig,
        activity=status.activity,
        fraction=status.fraction,
        remaining_seconds=status.remaining_seconds,
        playbacks=len(status.iterations),
        error=None if table is None else float(table.overall[-1]),
        proposal=status.hold.number,
    )


def _recorder(held: list[recorder_pb2.RecordingInfo], folder: Path | None) -> RecorderStatus:
    free = None
    if folder is not None:
        with suppress(OSError):
            free = shutil.disk_usage(folder).free
    return RecorderStatus(
        recordings=len(held),
        open_recordings=sum(not information.closed for information in held),
        bytes=sum(information.bytes for information in held),
        missing_blocks=sum(information.missing_blocks for information in held),
        waiting=next((information.waiting for information in held if information.waiting), ""),
        free_bytes=free,
    )
