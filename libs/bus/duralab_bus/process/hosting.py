"""Services in one process on one bus: what a sweep's worker has instead of a process for each of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Final

from pydantic import ValidationError

from duralab_bus.bus import Bus
from duralab_bus.process.service import Build, ServiceConfig
from duralab_bus.yaml_config import ConfigError
from duralab_proto.keys import MAIN_INSTANCE
from duralab_settings import explain_validation

GROUP: Final = "duralab.services"
"""Entry points under which the installed services name what they are made of."""


@dataclass(frozen=True)
class HostedService:
    """Parts of a service, with or without its own process.

    Parameters
    ----------
    name : str
        As in its liveliness key.
    config_type : type
        Its configuration.
    build : callable
        Given the configuration, returns what sets it up on a bus; see `run_service`.
    instances : tuple of str
        What is declared live when it stands; none where the service does so itself.
    """

    name: str
    config_type: type[ServiceConfig]
    build: Callable[[Any], Build]
    instances: tuple[str, ...] = (MAIN_INSTANCE,)


def installed_services() -> dict[str, HostedService]:
    """Return the services that are installed here, by name; all of them are imported."""
    return {entry.name: entry.load() for entry in entry_points(group=GROUP)}


@contextmanager
def host_services(
    bus: Bus, settings: Mapping[str, Mapping[str, object]], *, among: Mapping[str, HostedService] | None = None
) -> Iterator[None]:
    """Run services in this process, on one session, until the block ends.

    No message leaves the process: a query or a block of a stream is a call from one thread to another. Nothing keeps
    one service from taking the others with it, which a rehearsal may accept and a lab may not.

    Parameters
    ----------
    bus : Bus
        The session of all of them; with workers for all of them.
    settings : mapping
        Configuration of each service by its name, without its bus. They are ended in the reverse order.
    among : mapping, optional
        The services by name; those that are installed where not given.

    Returns
    -------
    context manager
        The services at work; gives nothing.

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
        # Before what was built is taken apart: a handler may be using it.
        stack.callback(bus.stop_serving)
        yield
