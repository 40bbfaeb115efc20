"""Rig simulator on the bus: simulated rigs behind the gateway that any rig has."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Self

import structlog
from pydantic import Field, model_validator

from duralab_bus import Bus, ConfigError
from duralab_gateway import (
    SERVICE,
    ChannelTable,
    GatewayConfig,
    RigServer,
    open_spools,
    require_served,
    serve_refusal,
)
from duralab_gateway.motion import RigFaultError
from rig_sim.bus import SimulatedRig
from rig_sim.engines import EngineChoice
from rig_sim.loading import load_any_rig, rigs_by_name
from rig_sim.parameters import Name
from rig_sim.playing import Fault
from rig_sim.specimen import SpecimenError, shipped_specimens


class RigSimConfig(GatewayConfig):
    """Configuration of the rig simulator."""

    #: Names of shipped rigs to serve.
    rigs: tuple[str, ...] = ("front_axle", "predecessor")
    #: YAML files of further rigs, each with its SDF beside it.
    specimens: tuple[Path, ...] = ()
    #: Faults to inject, by the rig's name, for tests and rehearsals.
    faults: dict[str, tuple[Fault, ...]] = Field(default_factory=dict)
    #: Engine by the rig's name; the compiled player by default.
    engines: dict[str, EngineChoice] = Field(default_factory=dict)
    #: Folder of the wear of specimens, so that it survives this process; in memory if not given.
    wear_folder: Path | None = None
    #: Name of the mounted specimen of its kind, by the name of a rig that wears; another name is a new specimen, or one
    #: that was mounted before.
    mounted: dict[str, Name] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _serves_something(self) -> Self:
        if not self.rigs and not self.specimens:
            raise ValueError("rigs and specimens are both empty; name at least one rig")
        return self


def find_rigs(config: RigSimConfig) -> dict[str, Path]:
    """Return the YAMLs of all configured rigs by the rigs' names."""
    shipped = shipped_specimens()
    unknown = [name for name in config.rigs if name not in shipped]
    if unknown:
        raise ConfigError(f"rigs: {', '.join(unknown)} is not a rig of this simulator; it ships {', '.join(shipped)}.")
    try:
        rigs = rigs_by_name([*(shipped[name] for name in config.rigs), *config.specimens])
    except SpecimenError as error:
        raise ConfigError(f"rigs: {error}") from error
    for what, names in (
        ("engines", config.engines),
        ("faults", config.faults),
        ("mounted", config.mounted),
    ):
        idle = [name for name in names if name not in rigs]
        if idle:
            raise ConfigError(f"{what}: {', '.join(idle)} is not a rig served here; those are {', '.join(rigs)}.")
    require_served(config.channels, list(rigs))
    return rigs


@contextmanager
def serve(bus: Bus, config: RigSimConfig) -> Iterator[list[RigServer]]:
    """Load the configured rigs, each served and declared live as soon as it is ready, until the block ends.

    A rig that cannot be used does not prevent others from being served: its queries are answered with the reason.
    """
    log = structlog.get_logger(SERVICE)
    servers: list[RigServer] = []
    unproven: list[tuple[RigServer, SimulatedRig]] = []
    refused: dict[str, str] = {}
    spools = open_spools(bus, config)
    try:
        for name, path in find_rigs(config).items():
            try:
                rig = SimulatedRig(
                    load_any_rig(path, config.engines, config.faults, config.mounted, prove_later=True),
                    wear_folder=config.wear_folder,
                )
            except (ValueError, RuntimeError, ArithmeticError, LookupError) as error:
                refused[name] = str(error)
                continue
            rig.follow_wear(bus.metrics)
            server = RigServer(
                bus,
                rig,
                spools,
                spool_wait_seconds=config.spool_wait_seconds,
                real_time=config.real_time,
                channels=config.channels.get(name, ChannelTable()),
            )
            servers.append(server)
            unproven.append((server, rig))
            # Last: a client that sees a rig may query it.
            bus.declare_live(SERVICE, name)
        if not servers:
            raise ConfigError(" ".join(refused.values()))
        for name, reason in refused.items():
            log.error("refused", rig=name, reason=reason)
            serve_refusal(bus, name, reason)
            bus.declare_live(SERVICE, name)
        # A rig describes itself before it is proven; a run waits for the proof.
        proving = Thread(target=_prove, args=(unproven,), name="rig_sim-proof", daemon=True)
        proving.start()
        yield servers
    finally:
        for server in servers:
            server.close()


def _prove(unproven: list[tuple[RigServer, SimulatedRig]]) -> None:
    """Prove rigs against Drake; latch one that disagrees, for as long as this process serves it."""
    for server, rig in unproven:
        try:
            rig.prove()
        except RigFaultError as error:
            server.stop(str(error).rstrip("."))
