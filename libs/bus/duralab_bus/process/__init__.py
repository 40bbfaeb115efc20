"""A service as a process: settings, logs, signals, hosting several in one, and diagnosis."""

from duralab_bus.process.hosting import HostedService, host_services
from duralab_bus.process.logs import configure_logs
from duralab_bus.process.service import ServiceConfig, keep_few_arenas, log_stacks_on_signal, service_main

__all__ = [
    "HostedService",
    "ServiceConfig",
    "configure_logs",
    "host_services",
    "keep_few_arenas",
    "log_stacks_on_signal",
    "service_main",
]
