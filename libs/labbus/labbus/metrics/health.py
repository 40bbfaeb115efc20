"""The health of a process as it goes over the bus: all its figures, in one answer."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Final

from duralab_proto.v1 import health_pb2
from labbus.metrics.registry import NO_LABELS, FigureKind, Figures, Labels

_KINDS: Final = {
    FigureKind.GAUGE: health_pb2.FIGURE_KIND_GAUGE,
    FigureKind.COUNTER: health_pb2.FIGURE_KIND_COUNTER,
}


class HealthTeller:
    """Tells how a process is; counts its time from its making.

    Parameters
    ----------
    figures : Figures
        Of the process.
    """

    def __init__(self, figures: Figures) -> None:
        self._figures = figures
        self._began = time.monotonic()
        figures.follow("duralab_up_seconds", "Time since the process joined the bus", self._read_up)

    def tell(self, service: str, instance: str) -> health_pb2.Health:
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
                for family in self._figures.families()
            ],
        )

    def _read_up(self) -> Mapping[Labels, float]:
        return {NO_LABELS: time.monotonic() - self._began}
