"""Typed queries, streams and liveliness over Zenoh: the only code of the project that imports it."""

from labbus._bus import Bus, LiveToken, open_bus
from labbus._call import Call
from labbus._config import BusConfig, BusMode
from labbus._continuity import Continuity
from labbus._encoding import encoding_of
from labbus._faults import BusError, FaultError
from labbus._liveliness import LiveWatch
from labbus._server import Served
from labbus._service import ServiceConfig, run_service, service_main
from labbus._stream_item import StreamItem
from labbus._streams import StreamPublisher, Subscription
from labbus._yaml import ConfigError, explain_validation, load_config

__all__ = [
    "Bus",
    "BusConfig",
    "BusError",
    "BusMode",
    "Call",
    "ConfigError",
    "Continuity",
    "FaultError",
    "LiveToken",
    "LiveWatch",
    "Served",
    "ServiceConfig",
    "StreamItem",
    "StreamPublisher",
    "Subscription",
    "encoding_of",
    "explain_validation",
    "load_config",
    "open_bus",
    "run_service",
    "service_main",
]
