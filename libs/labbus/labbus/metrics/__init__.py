"""Metrics of a process: counted and read here, served to Prometheus and to health queries."""

from labbus.metrics.health import HealthService
from labbus.metrics.prometheus import MetricsConfig, serve_metrics
from labbus.metrics.registry import NO_LABELS, Counter, FigureFamily, FigureKind, Labels, Metrics

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
