"""Answer to a health query: all metrics of the process in one message."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Final

from duralab_bus.metrics.registry import NO_LABELS, FigureKind, Labels, Metrics
from duralab_proto.v1 import health_pb2

_KINDS: Final = {
    FigureKind.GAUGE: health_pb2.FIGURE_KIND_GAUGE,
    FigureKind.COUNTER: health_pb2.FIGURE_KIND_COUNTER,
}


class HealthService:
    """Health of a process; its uptime counts from the construction of this object.

    `metrics`: Metrics of the process.
    """

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._began = time.monotonic()
        metrics.follow("duralab_up_seconds", "Time since the process joined the bus", self._read_up)

    def report(self, service: str, instance: str) -> health_pb2.Health:
        """Return the health of an instance."""
        return health_pb2.Health(
            service=service,
            instance=instance,
            up_seconds=time.monotonic() - self._began,
            figures=[
                health_pb2.FigureFamily(
                    name=family.name,
                    kind=_KINDS[family.kind],
                    what=family.what,
                    labels=family.labels,
                    values=[
                        health_pb2.FigureValue(labels=labels, value=value)
                        for labels, value in sorted(family.values.items())
                    ],
                )
                for family in self._metrics.families()
            ],
        )

    def _read_up(self) -> Mapping[Labels, float]:
        return {NO_LABELS: time.monotonic() - self._began}
