"""How a lab is: the figures of its services, as each tells them; Prometheus is told the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from duralab_bus import Bus, FaultError, FigureKind
from duralab_proto.v1 import health_pb2, query_pb2

SILENCE_SECONDS: Final = 3.0
"""A service that gives no sign of life for so long is told of as silent."""

_KINDS: Final = {
    health_pb2.FIGURE_KIND_GAUGE: FigureKind.GAUGE,
    health_pb2.FIGURE_KIND_COUNTER: FigureKind.COUNTER,
}


@dataclass(frozen=True)
class Figure:
    """One figure of a service.

    `name`: As Prometheus is told it, with its unit, e.g. "duralab_recorder_lag_seconds". `what`: In words. `kind`:
    Whether it goes up and down, or counts from the start of the process. `labels`: What it is about, e.g. {"rig":
    "front_axle"}; may be empty. `value`: In SI units.
    """

    name: str
    what: str
    kind: FigureKind
    labels: Mapping[str, str]
    value: float


@dataclass(frozen=True)
class ServiceHealth:
    """How one instance of a service is.

    `service`: E.g. "recorder". `instance`: A rig's name, of rig_sim; "main" of the others. `up_seconds`: How long its
    process is on the bus; not a number where it does not tell. `figures`: Of its process: rigs of one process tell the
    same. `trouble`: Why it does not tell, in one sentence; empty where it does.
    """

    service: str
    instance: str
    up_seconds: float = float("nan")
    figures: tuple[Figure, ...] = field(default=(), repr=False)
    trouble: str = ""

    def value(self, name: str, **labels: str) -> float | None:
        """Return the sum of a figure's values over those with these labels; None where it does not tell of it.

        `name`: Name of the figure.
        Returns: The sum, or None.
        """
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
        health = bus.query(
            bus.keys.health(service, instance),
            health_pb2.HealthRequest(),
            health_pb2.Health,
            silence_seconds=SILENCE_SECONDS,
        )
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
