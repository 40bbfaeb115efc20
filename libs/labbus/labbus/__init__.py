"""Typed queries, streams and liveliness over Zenoh: the only code of the project that imports it."""

from labbus._arenas import keep_few_arenas
from labbus._bus import Bus, LiveToken, open_bus
from labbus._call import Call
from labbus._client import Cancel
from labbus._config import BusConfig, BusMode, TlsConfig
from labbus._continuity import Continuity
from labbus._encoding import encoding_of
from labbus._faults import BusError, FaultError
from labbus._figures import FigureFamily, FigureKind, Figures, Tally
from labbus._hosting import HostedService, host_services, installed_services
from labbus._liveliness import LiveWatch
from labbus._logs import configure_logs
from labbus._metrics import MetricsConfig
from labbus._router import DEFAULT_HOLDERS, DEFAULT_PORT, router_configuration, run_router
from labbus._server import Served
from labbus._service import ServiceConfig, run_service, service_main
from labbus._spool import SpoolFullError, SpoolSpace
from labbus._spool_folder import SpoolFolder
from labbus._stacks import tell_stacks_on_signal
from labbus._stream_item import StreamItem
from labbus._stream_order import StreamProof
from labbus._streams import StreamPublisher
from labbus._subscription import Subscription
from labbus._yaml import ConfigError, explain_validation, load_config

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
    "FaultError",
    "FigureFamily",
    "FigureKind",
    "Figures",
    "HostedService",
    "LiveToken",
    "LiveWatch",
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
    "Tally",
    "TlsConfig",
    "configure_logs",
    "encoding_of",
    "explain_validation",
    "host_services",
    "installed_services",
    "keep_few_arenas",
    "load_config",
    "open_bus",
    "router_configuration",
    "run_router",
    "run_service",
    "service_main",
    "tell_stacks_on_signal",
]
