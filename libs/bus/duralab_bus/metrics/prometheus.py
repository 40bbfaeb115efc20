"""The metrics of a process for Prometheus: one page over HTTP, if the configuration asks for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from pydantic import BaseModel, ConfigDict, Field

from duralab_bus.metrics.registry import FigureKind, Metrics
from duralab_bus.yaml_config import ConfigError

if TYPE_CHECKING:
    from prometheus_client.metrics_core import Metric

PAGE: Final = "/metrics"


class MetricsConfig(BaseModel):
    """Address at which the metrics are served to Prometheus."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # The page has no access control: loopback, or an address that only the scraper reaches.
    host: str = "127.0.0.1"
    # 0 takes a free one; the log says which.
    port: int = Field(ge=0, le=2**16 - 1)


class _Collector:
    """Converter of the metrics to Prometheus' classes, each time the page is requested."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics

    def collect(self) -> Iterator[Metric]:
        from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily

        for family in self._metrics.families():
            kind = CounterMetricFamily if family.kind is FigureKind.COUNTER else GaugeMetricFamily
            metric = kind(family.name, family.what, labels=family.labels)
            for labels, value in sorted(family.values.items()):
                metric.add_metric(labels, value)
            yield metric


@contextmanager
def serve_metrics(config: MetricsConfig, metrics: Metrics) -> Iterator[str]:
    """Serve the metrics to Prometheus until the `with` block ends.

    `config`: Host and port of the page. `metrics`: Metrics of the process.
    Yields: Address of the page.
    Raises `ConfigError`: The host is none of this machine's, or the port is in use.
    """
    # A tenth of a second to import, which a lab script need not wait for.
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
            f"The figures cannot be told at {config.host}:{config.port}: {error.strerror or error}; correct `metrics`."
        ) from error
    try:
        yield f"http://{config.host}:{server.server_port}{PAGE}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
