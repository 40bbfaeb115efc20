"""Typed queries, streams and liveliness over Zenoh: the only code of the project that imports it."""

from duralab_bus.bus import Bus, open_bus
from duralab_bus.commanding import (
    SAMPLES_LACK,
    Admissions,
    Admitted,
    OpenHold,
    RecordingLog,
    StatusBoard,
    already_exists,
    bring_to_rest,
    damaged_recording,
    described_rig,
    early_end,
    halt_rig,
    message_of_step,
    recorded_steps,
)
from duralab_bus.encoding import encoding_of
from duralab_bus.faults import BusError, FaultError
from duralab_bus.metrics import FigureKind, Metrics
from duralab_bus.process import (
    HostedService,
    ServiceConfig,
    configure_logs,
    host_services,
    import_base_of_scipy,
    import_in_background,
    keep_few_arenas,
    log_stacks_on_signal,
    service_main,
)
from duralab_bus.queries import Call
from duralab_bus.security import DEFAULT_PORT, router_configuration, run_router
from duralab_bus.session import BusConfig, BusMode, TlsConfig, check_identity, member_of
from duralab_bus.spool import SpoolFolder, SpoolFullError, SpoolSpace
from duralab_bus.streams import Continuity, StreamItem, StreamProof, StreamPublisher, Subscription
from duralab_bus.tracing import SUFFIX as TRACE_SUFFIX
from duralab_bus.tracing import SpanKind, record_trace, span, spans, write_span
from duralab_bus.yaml_config import ConfigError, load_config

__all__ = [
    "DEFAULT_PORT",
    "SAMPLES_LACK",
    "TRACE_SUFFIX",
    "Admissions",
    "Admitted",
    "Bus",
    "BusConfig",
    "BusError",
    "BusMode",
    "Call",
    "ConfigError",
    "Continuity",
    "FaultError",
    "FigureKind",
    "HostedService",
    "Metrics",
    "OpenHold",
    "RecordingLog",
    "ServiceConfig",
    "SpanKind",
    "SpoolFolder",
    "SpoolFullError",
    "SpoolSpace",
    "StatusBoard",
    "StreamItem",
    "StreamProof",
    "StreamPublisher",
    "Subscription",
    "TlsConfig",
    "already_exists",
    "bring_to_rest",
    "check_identity",
    "configure_logs",
    "damaged_recording",
    "described_rig",
    "early_end",
    "encoding_of",
    "halt_rig",
    "host_services",
    "import_base_of_scipy",
    "import_in_background",
    "keep_few_arenas",
    "load_config",
    "log_stacks_on_signal",
    "member_of",
    "message_of_step",
    "open_bus",
    "record_trace",
    "recorded_steps",
    "router_configuration",
    "run_router",
    "service_main",
    "span",
    "spans",
    "write_span",
]
