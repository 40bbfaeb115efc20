"""The figures of a process for Prometheus: one page over HTTP, where the configuration asks for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from pydantic import BaseModel, ConfigDict, Field

from labbus.metrics.registry import FigureKind, Figures
from labbus.yaml_config import ConfigError

if TYPE_CHECKING:
    from prometheus_client.metrics_core import Metric

PAGE: Final = "/metrics"


class MetricsConfig(BaseModel):
    """Where the figures are told to Prometheus."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # The page asks nobody who he is: loopback, or an address that only the scraper reaches.
    host: str = "127.0.0.1"
    # 0 takes a free one; the log says which.
    port: int = Field(ge=0, le=2**16 - 1)


class _Collector:
    """Hands the figures over in Prometheus' own classes, whenever the page is asked for."""

    def __init__(self, figures: Figures) -> None:
        self._figures = figures

    def collect(self) -> Iterator[Metric]:
        from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily

        for family in self._figures.families():
            kind = CounterMetricFamily if family.kind is FigureKind.COUNTER else GaugeMetricFamily
            metric = kind(family.name, family.what, labels=family.labels)
            for labels, value in sorted(family.values.items()):
                metric.add_metric(labels, value)
            yield metric


@contextmanager
def tell_prometheus(config: MetricsConfig, figures: Figures) -> Iterator[str]:
    """Serve the figures to Prometheus until the `with` block ends.

    Parameters
    ----------
    config : MetricsConfig
        Host and port of the page.
    figures : Figures
        Figures of the process.

    Yields
    ------
    str
        Address of the page.

    Raises
    ------
    ConfigError
        The host is none of this machine's, or the port is in use.
    """
    # A tenth of a second to import, which a lab script need not wait for.
    from prometheus_client import start_http_server
    from prometheus_client.process_collector import ProcessCollector
    from prometheus_client.registry import CollectorRegistry

    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(figures))
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
