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
"""Time without a sign of life after which a service is reported as silent."""

MessageT = TypeVar("MessageT", bound=Message)

_KINDS: Final = {
    health_pb2.FIGURE_KIND_GAUGE: FigureKind.GAUGE,
    health_pb2.FIGURE_KIND_COUNTER: FigureKind.COUNTER,
}


@dataclass(frozen=True)
class Figure:
    """Metric of a service in SI units; its name and labels, e.g. {"rig": "front_axle"}, are those of Prometheus."""

    name: str
    what: str
    kind: FigureKind
    labels: Mapping[str, str]
    value: float


@dataclass(frozen=True)
class ServiceHealth:
    """Health of one instance of a service; the instance is a rig's name, or "main".

    `up_seconds`: Time of its process on the bus; NaN if not reported. `figures`: Metrics; rigs of one process report
    the same. `trouble`: Reason why there is no report, in one sentence; empty if there is one.
    """

    service: str
    instance: str
    up_seconds: float = float("nan")
    figures: tuple[Figure, ...] = field(default=(), repr=False)
    trouble: str = ""

    def value(self, name: str, **labels: str) -> float | None:
        """Return the sum of a metric's values with these labels; None if the service does not report it."""
        found = [
            figure.value
            for figure in self.figures
            if figure.name == name and all(figure.labels.get(label) == value for label, value in labels.items())
        ]
        return sum(found) if found else None


def health_of(bus: Bus) -> list[ServiceHealth]:
    """Return the health of all services on the bus."""
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
"""Services of a complete lab; of the first, one instance for each rig."""


@dataclass(frozen=True)
class CampaignUnderWay:
    """Status of a campaign that has not ended.

    `error`: Overall error of its last playback, None before the first. `proposal`: Number of the proposal that waits
    for a decision; 0 if the campaign does not wait.
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

    `missing_blocks`: Number of signal blocks that were sent but not yet received; of an ended run, lost blocks.
    `waiting`: Reason why the recorder cannot write now; empty if it can.
    """

    recordings: int
    open_recordings: int
    bytes: int
    missing_blocks: int
    waiting: str
    free_bytes: int | None


@dataclass(frozen=True)
class LabStatus:
    """State of a lab; `missing` names the services that do not run, and `recorder` is None without a recorder."""

    missing: tuple[str, ...]
    services: tuple[ServiceHealth, ...]
    rigs: tuple[RigState, ...]
    campaigns: tuple[CampaignUnderWay, ...]
    recorder: RecorderStatus | None

    @property
    def whole(self) -> bool:
        """Whether all services run and the recorder can write."""
        return not self.missing and (self.recorder is None or not self.recorder.waiting)


def lab_status(bus: Bus, *, recordings: Path | None = None) -> LabStatus:
    """Query all services of a lab and return its state; `recordings` is the recorder's folder, if on this machine."""
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
        # A latched rig that is not at rest either ramps down, or plays a run that cannot be stopped to its end.
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
        # The iterator has no campaign for a recording interrupted before its start; it waits for `duralab resume`.
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
