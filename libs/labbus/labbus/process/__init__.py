"""A service as a process: settings, logs, signals, hosting several in one, and diagnosis."""

from labbus.process.arenas import keep_few_arenas
from labbus.process.hosting import HostedService, host_services, installed_services
from labbus.process.logs import configure_logs
from labbus.process.service import ServiceConfig, run_service, service_main
from labbus.process.settings import configured
from labbus.process.stacks import log_stacks_on_signal

__all__ = [
    "HostedService",
    "ServiceConfig",
    "configure_logs",
    "configured",
    "host_services",
    "installed_services",
    "keep_few_arenas",
    "log_stacks_on_signal",
    "run_service",
    "service_main",
]
