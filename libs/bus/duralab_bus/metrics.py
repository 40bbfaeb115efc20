"""Metrics of a process: counters, and values that are read on request; for health queries and Prometheus."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Final

import structlog
from pydantic import BaseModel, ConfigDict, Field

from duralab_bus.yaml_config import ConfigError
from duralab_proto.v1 import health_pb2

if TYPE_CHECKING:
    from prometheus_client.metrics_core import Metric

Labels = tuple[str, ...]
"""Values of a family's labels, in the order of their names."""

Reading = Callable[[], Mapping[Labels, float]]

NO_LABELS: Final[Labels] = ()
PAGE: Final = "/metrics"

_NAME = re.compile(r"duralab_[a-z][a-z0-9_]*[a-z0-9]")
_COUNTER_ENDING: Final = "_total"


class FigureKind(StrEnum):
    """Behaviour of a metric over time; named as in the contract."""

    GAUGE = "gauge"
    """Value that goes up and down."""
    COUNTER = "counter"
    """Count from the start of the process; it never decreases."""


@dataclass
class FigureFamily:
    """All values of one metric: its name with the unit, its description, the names of its labels, and its readers."""

    name: str
    kind: FigureKind
    what: str
    labels: Labels
    readings: list[Reading] = field(default_factory=list)

    @property
    def values(self) -> dict[Labels, float]:
        """Present values by the labels' values, in order; empty if there are none now."""
        values: dict[Labels, float] = {}
        for read in list(self.readings):
            try:
                values |= read()
            except Exception:  # noqa: BLE001 - one metric that cannot be read must not hide all others
                structlog.get_logger("duralab_bus").exception("A figure could not be read.", figure=self.name)
        return dict(sorted(values.items()))


class Counter:
    """Counter with a value for each combination of labels; made by `Metrics.count`. Safe for threads."""

    def __init__(self, labels: Labels) -> None:
        self._labels = labels
        self._lock = threading.Lock()
        self._values: dict[Labels, float] = {} if labels else {NO_LABELS: 0.0}

    def add(self, *labels: str, amount: float = 1.0) -> None:
        """Add 0 or more, with as many labels as the counter has; use few combinations, each is kept for good."""
        with self._lock:
            if labels in self._values:
                self._values[labels] += amount
                return
            if len(labels) != len(self._labels):
                raise ValueError(
                    f"{labels} are {len(labels)} labels; this counter has {len(self._labels)}: {self._labels}."
                )
            self._values[labels] = amount

    def read(self) -> Mapping[Labels, float]:
        """Return the counts by the labels' values."""
        with self._lock:
            return dict(self._values)


class Metrics:
    """Registry of the metrics of one process. Safe for threads."""

    # Not the registry of prometheus_client, which only serves the page: it takes one collector per name, while the
    # rigs of a process share names, and one failing collector breaks its page. Its labelled counters take three times
    # as long (1.2 instead of 0.4 us), and every client would import it.

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._families: dict[str, FigureFamily] = {}

    def count(self, name: str, what: str, *, labels: Labels = NO_LABELS) -> Counter:
        """Return a new counter, named `duralab_…_total`."""
        counter = Counter(labels)
        self.follow(name, what, counter.read, labels=labels, kind=FigureKind.COUNTER)
        return counter

    def follow(
        self,
        name: str,
        what: str,
        read: Reading,
        *,
        labels: Labels = NO_LABELS,
        kind: FigureKind = FigureKind.GAUGE,
    ) -> None:
        """Register a function that is called each time the metrics are read; one name may have several.

        `name`: `duralab_…`, with the unit at its end. `what`: Description. `read`: Returns the values by the labels'
        values; called on any thread, returns at once. `labels`: Their names.
        """
        if _NAME.fullmatch(name) is None or name.endswith(_COUNTER_ENDING) != (kind is FigureKind.COUNTER):
            raise ValueError(f"The {kind} {name!r} must be named 'duralab_…', and end in '_total' if it is a counter.")
        with self._lock:
            family = self._families.setdefault(name, FigureFamily(name, kind, what, labels))
            if (family.kind, family.what, family.labels) != (kind, what, labels):
                raise ValueError(f"The figure {name!r} already exists, as another kind, with other words or labels.")
            family.readings.append(read)

    def families(self) -> list[FigureFamily]:
        """Return all metrics, ordered by name."""
        with self._lock:
            return [family for _, family in sorted(self._families.items())]


class HealthService:
    """Answer to health queries: all metrics of the process; uptime counts from the construction of this object."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._began = time.monotonic()
        metrics.follow("duralab_up_seconds", "Time since the process joined the bus", lambda: {NO_LABELS: self._up})

    def report(self, service: str, instance: str) -> health_pb2.Health:
        """Return the health of an instance."""
        health = health_pb2.Health(service=service, instance=instance, up_seconds=self._up)
        for family in self._metrics.families():
            kind = health_pb2.FigureKind.Value(f"FIGURE_KIND_{family.kind.name}")
            figure = health.figures.add(name=family.name, kind=kind, what=family.what, labels=family.labels)
            for labels, value in family.values.items():
                figure.values.add(labels=labels, value=value)
        return health

    @property
    def _up(self) -> float:
        return time.monotonic() - self._began


class MetricsConfig(BaseModel):
    """Address at which the metrics are served to Prometheus."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # The page has no access control: use loopback, or an address that only the scraper reaches.
    host: str = "127.0.0.1"
    # 0 takes a free port; the log states it.
    port: int = Field(ge=0, le=2**16 - 1)


class _Collector:
    """Converter of the metrics to Prometheus' classes, on each request of the page."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics

    def collect(self) -> Iterator[Metric]:
        from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily

        for family in self._metrics.families():
            kind = CounterMetricFamily if family.kind is FigureKind.COUNTER else GaugeMetricFamily
            metric = kind(family.name, family.what, labels=family.labels)
            for labels, value in family.values.items():
                metric.add_metric(labels, value)
            yield metric


@contextmanager
def serve_metrics(config: MetricsConfig, metrics: Metrics) -> Iterator[str]:
    """Serve the metrics to Prometheus until the `with` block ends; yields the address of the page.

    Raises `ConfigError`: The host is not an address of this machine, or the port is in use.
    """
    # The import takes 0.1 s, which a lab script need not wait for.
    from prometheus_client import start_http_server
    from prometheus_client.process_collector import ProcessCollector
    from prometheus_client.registry import CollectorRegistry

    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(metrics))
    ProcessCollector(registry=registry)
    try:
        server, thread = start_http_server(config.port, addr=config.host, registry=registry)
    except OSError as error:
        raise ConfigError(
            f"No metrics can be served at {config.host}:{config.port}: {error.strerror or error}; correct `metrics`."
        ) from error
    try:
        yield f"http://{config.host}:{server.server_port}{PAGE}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
