"""Process of a service: settings, logs, signals, several services in one process, and diagnosis."""

from duralab_bus.process.background_imports import import_base_of_scipy, import_in_background
from duralab_bus.process.hosting import HostedService, host_services
from duralab_bus.process.logs import configure_logs
from duralab_bus.process.service import ServiceConfig, keep_few_arenas, log_stacks_on_signal, service_main

__all__ = [
    "HostedService",
    "ServiceConfig",
    "configure_logs",
    "host_services",
    "import_base_of_scipy",
    "import_in_background",
    "keep_few_arenas",
    "log_stacks_on_signal",
    "service_main",
]
