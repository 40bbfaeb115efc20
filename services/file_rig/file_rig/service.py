"""File rigs on the bus: one for each controller map of the configuration."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import structlog
from pydantic import Field

from duralab_bus import Bus, ConfigError
from duralab_drive_files import DriveFileError, Outbox, read_controller_map
from duralab_gateway import SERVICE, GatewayConfig, RigServer, open_spools, require_served
from file_rig.file_rig import FileRig


class FileRigConfig(GatewayConfig):
    """Configuration of a process that serves rigs behind controllers that exchange files."""

    #: Controller maps, YAML; sensors and calculated channels are in the map, or here under `channels`.
    maps: tuple[Path, ...] = Field(min_length=1)


@contextmanager
def serve(bus: Bus, config: FileRigConfig) -> Iterator[list[RigServer]]:
    """Serve the rig of every map, each declared live, until the block ends; waiting orders stay for the next one."""
    log = structlog.get_logger(SERVICE)
    spools = open_spools(bus, config)
    servers: list[RigServer] = []
    with ExitStack() as stack:
        try:
            maps = [read_controller_map(path) for path in config.maps]
            require_served(config.channels, [each.rig for each in maps])
            for each in maps:
                rig = FileRig(stack.enter_context(closing(Outbox(each))))
                if (order := rig.outbox.waiting()) is not None:
                    log.warning("a run waits for its response", rig=each.rig, run=order.run, since=order.written)
                channels = config.channels.get(each.rig) or each.channels
                server = RigServer(bus, rig, spools, spool_wait_seconds=config.spool_wait_seconds, channels=channels)
                stack.callback(server.close)
                # Before the servers close: the end of this process must not stop waiting orders.
                stack.callback(rig.leave)
                servers.append(server)
                # Last: a client that sees a rig may query it.
                bus.declare_live(SERVICE, each.rig)
        except DriveFileError as error:
            raise ConfigError(f"maps: {error}") from error
        yield servers
