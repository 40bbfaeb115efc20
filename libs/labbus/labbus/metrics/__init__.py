"""Metrics of a process: counted and read here, served to Prometheus and to health queries."""

from labbus.metrics.health import HealthTeller
from labbus.metrics.prometheus import MetricsConfig, tell_prometheus
from labbus.metrics.registry import NO_LABELS, FigureFamily, FigureKind, Figures, Labels, Tally

__all__ = [
    "NO_LABELS",
    "FigureFamily",
    "FigureKind",
    "Figures",
    "HealthTeller",
    "Labels",
    "MetricsConfig",
    "Tally",
    "tell_prometheus",
]
