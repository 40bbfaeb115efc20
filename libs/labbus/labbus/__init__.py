"""Typed queries, streams and liveliness over Zenoh: the only code of the project that imports it."""

from labbus.bus import Bus, LiveToken, open_bus
from labbus.encoding import encoding_of
from labbus.faults import BusError, FaultError
from labbus.metrics import Counter, FigureFamily, FigureKind, Metrics, MetricsConfig
from labbus.process import (
    HostedService,
    ServiceConfig,
    configure_logs,
    host_services,
    installed_services,
    keep_few_arenas,
    log_stacks_on_signal,
    run_service,
    service_main,
)
from labbus.queries import Call, Cancel, Served
from labbus.security import DEFAULT_HOLDERS, DEFAULT_PORT, router_configuration, run_router
from labbus.session import BusConfig, BusMode, Identity, LiveWatch, TlsConfig, check_identity
from labbus.spool import SpoolFolder, SpoolFullError, SpoolSpace
from labbus.streams import Continuity, StreamItem, StreamProof, StreamPublisher, Subscription
from labbus.yaml_config import ConfigError, load_config

__all__ = [
    "DEFAULT_HOLDERS",
    "DEFAULT_PORT",
    "Bus",
    "BusConfig",
    "BusError",
    "BusMode",
    "Call",
    "Cancel",
    "ConfigError",
    "Continuity",
    "Counter",
    "FaultError",
    "FigureFamily",
    "FigureKind",
    "HostedService",
    "Identity",
    "LiveToken",
    "LiveWatch",
    "Metrics",
    "MetricsConfig",
    "Served",
    "ServiceConfig",
    "SpoolFolder",
    "SpoolFullError",
    "SpoolSpace",
    "StreamItem",
    "StreamProof",
    "StreamPublisher",
    "Subscription",
    "TlsConfig",
    "check_identity",
    "configure_logs",
    "encoding_of",
    "host_services",
    "installed_services",
    "keep_few_arenas",
    "load_config",
    "log_stacks_on_signal",
    "open_bus",
    "router_configuration",
    "run_router",
    "run_service",
    "service_main",
]
