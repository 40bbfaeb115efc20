"""Process of rigs, and rigs within another process: configuration, spools, servers, and an orderly end."""

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

    #: Play every drive in real time, regardless of its request: as a real rig does, and its rehearsal. The responses of
    #: a simulated rig are the same.
    real_time: bool = False
    #: Folder on disk for signal blocks until the recorder has stored them, so that they survive this process; in memory
    #: if omitted.
    spool_folder: Path | None = None
    #: Bound of all spools together, in bytes.
    spool_bytes: int = Field(default=512 * 2**20, ge=16 * 2**20)
    #: Time that a simulation without spool room waits for the recorder, in s, before it ramps down. A rig that plays in
    #: real time cannot wait.
    spool_wait_seconds: float = Field(default=30.0, ge=0.0, le=3600.0)
    #: Sensors and calculated channels of the responses, by the rig's name.
    channels: dict[str, ChannelTable] = Field(default_factory=dict)


def open_spools(bus: Bus, config: GatewayConfig) -> SpoolSpace:
    """Return the space for signal blocks; blocks of a killed predecessor are offered to the recorder.

    Parameters
    ----------
    bus : Bus
        Bus of the rigs.
    config : GatewayConfig
        Configuration with or without a folder of the spools.

    Returns
    -------
    SpoolSpace
        Space on disk or in memory, for all rigs of the process.
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
        Channel tables of the configuration.
    rigs : sequence of str
        Names of the rigs served.

    Raises
    ------
    ConfigError
        If a table is of another rig; one sentence.
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
        Bus on which they are served, each under the name in its description.
    *rigs : Rig
        One or more rigs.
    config : GatewayConfig
        Pace and spools; its `bus` is not used.
    approach : Approach
        Ramps of all rigs to the first sample of a drive and back.

    Yields
    ------
    list of RigServer
        Servers in the order of the rigs.

    Raises
    ------
    ConfigError
        If a description or a table of channels cannot be served; one sentence.
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
            # Last: a client that sees a rig may send queries to it.
            bus.declare_live(SERVICE, description.rig)
        yield servers
    finally:
        for server in servers:
            server.close()


def serve(*rigs: Rig, approach: Approach = Approach(), real_time: bool = True) -> None:  # noqa: B008 - frozen
    """Run a process that serves rigs until it is ended: `python FILE --config FILE`.

    Like every service, the process has a log, health, metrics and an end within a time limit; see
    `duralab_bus.service_main`.

    Parameters
    ----------
    *rigs : Rig
        One or more rigs.
    approach : Approach
        Ramps of all rigs to the first sample of a drive and back.
    real_time : bool
        Whether the rigs play in real time if the configuration does not state it; False for a simulation.

    Raises
    ------
    ValueError
        If no rig is given.
    SystemExit
        With code 2 and one sentence on standard error, if the configuration or a description is not possible.
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
"""Group of the entry points of plug-ins: each names a class of a rig, called with its settings as keywords."""

_METHODS: Final = ("describe", "play", "stop", "reset")


class PluginGatewayConfig(_RealTimeConfig):
    """Configuration of a process that serves rigs of plug-ins."""

    #: Settings of each plug-in, by the name of its entry point in the group duralab.rigs.
    rigs: dict[str, dict[str, Any]] = Field(min_length=1)


def rig_plugin(name: str, settings: Mapping[str, Any]) -> Rig:
    """Return the rig of an installed plug-in.

    Parameters
    ----------
    name : str
        Name of an entry point in the group `duralab.rigs`.
    settings : mapping
        Keyword arguments of the class that the entry point names.

    Returns
    -------
    Rig
        Rig with the four methods.

    Raises
    ------
    ConfigError
        No plug-in or more than one has the name, it cannot be imported, it is not a class with the four methods, or its
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
