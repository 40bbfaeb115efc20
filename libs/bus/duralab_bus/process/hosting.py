"""Services in one process on one bus, for a sweep's worker: it needs no process for each of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from pydantic import ValidationError

from duralab_bus.bus import Bus
from duralab_bus.process.service import Build, ServiceConfig
from duralab_bus.yaml_config import ConfigError
from duralab_proto.keys import MAIN_INSTANCE
from duralab_settings import explain_validation

GROUP: Final = "duralab.services"
"""Group of the entry points in which installed services name their `HostedService`."""


@dataclass(frozen=True)
class HostedService:
    """Parts of a service, with or without a separate process.

    Parameters
    ----------
    name : str
        Name of the service, as in its liveliness key.
    config_type : type
        Type of its configuration.
    build : callable
        Takes the configuration and returns the function that sets the service up on a bus; see `run_service`.
    instances : tuple of str
        Instances that are declared live after the set-up; empty if the service declares them itself.
    """

    name: str
    config_type: type[ServiceConfig]
    build: Callable[[Any], Build]
    instances: tuple[str, ...] = (MAIN_INSTANCE,)


def installed_services() -> dict[str, HostedService]:
    """Return the installed services by name; all of them are imported."""
    return {entry.name: entry.load() for entry in _entries()}


@cache
def _entries() -> tuple[EntryPoint, ...]:
    """Return the entry points; the metadata of all packages are read once, and not for every cell of a sweep."""
    return tuple(entry_points(group=GROUP))


@contextmanager
def host_services(
    bus: Bus, settings: Mapping[str, Mapping[str, object]], *, among: Mapping[str, HostedService] | None = None
) -> Iterator[None]:
    """Run services in this process, on one session, until the block ends.

    No message leaves the process: a query or a block of a stream is a call from one thread to another. A crash of one
    service ends the others too, which is acceptable for a rehearsal but not for a lab.

    Parameters
    ----------
    bus : Bus
        Session of all services, with workers for all of them.
    settings : mapping
        Configuration of each service by its name, without its bus. The services end in the reverse order.
    among : mapping, optional
        Services by name; the installed ones if omitted.

    Returns
    -------
    context manager
        Context in which the services run; yields None.

    Raises
    ------
    ConfigError
        A service is not installed, or cannot be set up as configured.
    """
    known = installed_services() if among is None else among
    if missing := [name for name in settings if name not in known]:
        raise ConfigError(f"{', '.join(missing)} is not installed here; installed are {', '.join(known) or 'none'}.")
    with ExitStack() as stack:
        for name, given in settings.items():
            service = known[name]
            try:
                config = service.config_type.model_validate(dict(given))
            except ValidationError as error:
                raise ConfigError(f"{name}: {explain_validation(error, service.config_type).sentence}") from error
            context = service.build(config)(bus)
            if context is not None:
                stack.enter_context(context)
            for instance in service.instances:
                bus.declare_live(name, instance)
        # First, so that no handler uses the services' contexts while they are closed.
        stack.callback(bus.stop_serving)
        yield
