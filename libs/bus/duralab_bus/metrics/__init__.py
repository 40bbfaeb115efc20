"""Metrics of a process: counted and read here, served to Prometheus and to health queries."""

from duralab_bus.metrics.health import HealthService
from duralab_bus.metrics.prometheus import MetricsConfig, serve_metrics
from duralab_bus.metrics.registry import NO_LABELS, Counter, FigureFamily, FigureKind, Labels, Metrics

__all__ = [
    "NO_LABELS",
    "Counter",
    "FigureFamily",
    "FigureKind",
    "HealthService",
    "Labels",
    "Metrics",
    "MetricsConfig",
    "serve_metrics",
]
