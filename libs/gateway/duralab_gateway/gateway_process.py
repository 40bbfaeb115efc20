"""Rigs as a process, or within one: configuration, spools, servers, and an end in order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Final, cast

import structlog
from pydantic import Field, ValidationError

from duralab_bus import Bus, ConfigError, ServiceConfig, SpoolFolder, SpoolSpace, service_main
from duralab_gateway.channels import ChannelTable
from duralab_gateway.description import complete_description
from duralab_gateway.motion import Approach
from duralab_gateway.rig import Rig, StepwiseRig
from duralab_gateway.server import SERVICE, RigServer
from duralab_settings import SettingsError, explain_validation, load_plugin, one_line


class GatewayConfig(ServiceConfig):
    """Configuration of a process that serves rigs."""

    #: Play every drive in real time, whatever its request says: what a real rig does, and a rehearsal of one. The
    #: responses of a simulated rig are the same.
    real_time: bool = False
    #: Where signal blocks lie on disk until the recorder has stored them, so that they survive this process; in memory
    #: where not given.
    spool_folder: Path | None = None
    #: Bound of all of it, in bytes.
    spool_bytes: int = Field(default=512 * 2**20, ge=16 * 2**20)
    #: How long a simulation waits for the recorder where there is no more room, in s, before it ramps down. A rig that
    #: plays in real time cannot wait.
    spool_wait_seconds: float = Field(default=30.0, ge=0.0, le=3600.0)
    #: Sensors and calculated channels of the responses, by the rig's name.
    channels: dict[str, ChannelTable] = Field(default_factory=dict)


def open_spools(bus: Bus, config: GatewayConfig) -> SpoolSpace:
    """Return where signal blocks are kept; what a killed predecessor left there is offered to the recorder.

    Parameters
    ----------
    bus : Bus
        Where the rigs are served.
    config : GatewayConfig
        With the folder of the spools, or none.

    Returns
    -------
    SpoolSpace
        On disk or in memory, for all rigs of the process.
    """
    if config.spool_folder is None:
        return SpoolSpace(config.spool_bytes)
    spools = SpoolFolder(config.spool_folder, largest_bytes=config.spool_bytes)
    if left := bus.serve_left_spools(spools):
        structlog.get_logger(SERVICE).warning("streams of a rig that was killed are served again", streams=left)
    return spools


def require_served(channels: Mapping[str, ChannelTable], rigs: Sequence[str]) -> None:
    """Refuse channel tables of rigs that are not served.

    Parameters
    ----------
    channels : mapping of str to ChannelTable
        Of the configuration.
    rigs : sequence of str
        Names of the rigs served.

    Raises
    ------
    ConfigError
        A table is of another rig; one sentence.
    """
    if idle := [name for name in channels if name not in rigs]:
        raise ConfigError(f"channels: {', '.join(idle)} is not a rig served here; those are {', '.join(rigs)}.")


@contextmanager
def serving(
    bus: Bus,
    *rigs: Rig,
    config: GatewayConfig = GatewayConfig(),  # noqa: B008 - frozen
    approach: Approach = Approach(),  # noqa: B008 - frozen
) -> Iterator[list[RigServer]]:
    """Serve rigs on an open bus, each declared live, until the block ends.

    Parameters
    ----------
    bus : Bus
        Where they are served, each under the name in its description.
    *rigs : Rig
        One or more.
    config : GatewayConfig
        Pace and spools; its `bus` is not used.
    approach : Approach
        Ways of all of them to the first sample of a drive and back.

    Yields
    ------
    list of RigServer
        In the order of the rigs.

    Raises
    ------
    ConfigError
        A description or a table of channels cannot be served; one sentence.
    """
    spools = open_spools(bus, config)
    servers: list[RigServer] = []
    descriptions = [complete_description(rig.describe()) for rig in rigs]
    require_served(config.channels, [description.rig for description in descriptions])
    try:
        for rig, description in zip(rigs, descriptions, strict=True):
            playing = StepwiseRig(rig, description, approach=approach)
            servers.append(
                RigServer(
                    bus,
                    playing,
                    spools,
                    spool_wait_seconds=config.spool_wait_seconds,
                    real_time=config.real_time,
                    channels=config.channels.get(description.rig, ChannelTable()),
                )
            )
            # Last: whoever sees a rig may ask it.
            bus.declare_live(SERVICE, description.rig)
        yield servers
    finally:
        for server in servers:
            server.close()


def serve(*rigs: Rig, approach: Approach = Approach(), real_time: bool = True) -> None:  # noqa: B008 - frozen
    """Run a process that serves rigs until it is ended: `python FILE --config FILE`.

    The process has a log, health, metrics and an end in time as every service; see `duralab_bus.service_main`.

    Parameters
    ----------
    *rigs : Rig
        One or more.
    approach : Approach
        Ways of all of them to the first sample of a drive and back.
    real_time : bool
        Whether the rigs play in real time where the configuration says nothing; False for a simulation.

    Raises
    ------
    ValueError
        No rig is given.
    SystemExit
        With code 2 and one sentence on standard error, where the configuration or a description cannot be.
    """
    if not rigs:
        raise ValueError("serve() has no rig; give it one or more.")

    def build(config: GatewayConfig) -> Callable[[Bus], AbstractContextManager[object]]:
        return lambda bus: serving(bus, *rigs, config=config, approach=approach)

    # The rigs declare themselves live.
    service_main(SERVICE, _RealTimeConfig if real_time else GatewayConfig, build, instances=lambda _: ())


class _RealTimeConfig(GatewayConfig):
    """Configuration of a process that serves real rigs."""

    real_time: bool = True


GROUP: Final = "duralab.rigs"
"""Entry points of plug-ins: each names a class of a rig, called with its settings as keyword arguments."""

_METHODS: Final = ("describe", "play", "stop", "reset")


class PluginGatewayConfig(_RealTimeConfig):
    """Configuration of a process that serves rigs of plug-ins."""

    #: Settings of each plug-in, by the name of its entry point in the group duralab.rigs.
    rigs: dict[str, dict[str, Any]] = Field(min_length=1)


def rig_plugin(name: str, settings: Mapping[str, Any]) -> Rig:
    """Return the rig that an installed distribution offers.

    Parameters
    ----------
    name : str
        Of an entry point in the group `duralab.rigs`.
    settings : mapping
        Keyword arguments of the class that it names.

    Returns
    -------
    Rig
        With the four methods of a rig.

    Raises
    ------
    ConfigError
        No plug-in or more than one has the name, it cannot be imported, it is no class with the four methods, or its
        settings are not allowed; one sentence.
    """
    field = f"rigs.{name}"
    try:
        found = load_plugin(GROUP, name, field=field)
    except SettingsError as error:
        raise ConfigError(str(error)) from error
    kind = found.content
    missing = [each for each in _METHODS if not callable(getattr(kind, each, None))]
    if missing or not isinstance(kind, type):
        lacks = f"without {', '.join(missing)}" if missing else "no class"
        raise ConfigError(
            f"{field}: what the rig plug-in of {found.source} names is {lacks}; its entry point must name a class with "
            f"the methods {', '.join(_METHODS)}."
        )
    try:
        return cast(Rig, kind(**settings))
    except ValidationError as error:
        raise ConfigError(f"{field}: {explain_validation(error, kind).sentence}") from error
    except Exception as error:
        raise ConfigError(
            f"{field}: the rig plug-in of {found.source} raised {one_line(error)} with the settings {dict(settings)}; "
            "correct the settings or the plug-in."
        ) from error


def serve_plugins() -> None:
    """Run a process that serves the rigs of installed plug-ins: `python -m duralab_gateway --config FILE`."""

    def build(config: PluginGatewayConfig) -> Callable[[Bus], AbstractContextManager[object]]:
        rigs = [rig_plugin(name, settings) for name, settings in config.rigs.items()]
        return lambda bus: serving(bus, *rigs, config=config)

    service_main(SERVICE, PluginGatewayConfig, build, instances=lambda _: ())
