"""Gateway of a rig on the bus: checks, playback, stop and latch, streams. A rig is a class of four methods."""

from importlib import import_module
from typing import TYPE_CHECKING

from duralab_gateway.motion import Approach, RigFaultError

if TYPE_CHECKING:
    from duralab_gateway.channels import CalculatedChannel, ChannelTable, weighted_sum
    from duralab_gateway.description import complete_description
    from duralab_gateway.gateway_process import (
        GatewayConfig,
        open_spools,
        require_served,
        rig_plugin,
        serve,
        serve_plugins,
        serving,
    )
    from duralab_gateway.rig import KnowsItsFrf, Phase, PlaybackRig, Rig, Run, RunEndedError, ShowsFrames
    from duralab_gateway.server import SERVICE, RigServer, serve_refusal

__all__ = [
    "SERVICE",
    "Approach",
    "CalculatedChannel",
    "ChannelTable",
    "GatewayConfig",
    "KnowsItsFrf",
    "Phase",
    "PlaybackRig",
    "Rig",
    "RigFaultError",
    "RigServer",
    "Run",
    "RunEndedError",
    "ShowsFrames",
    "complete_description",
    "open_spools",
    "require_served",
    "rig_plugin",
    "serve",
    "serve_plugins",
    "serve_refusal",
    "serving",
    "weighted_sum",
]

_MODULES = ("channels", "rig", "description", "gateway_process", "server")


def __getattr__(name: str) -> object:
    """Import the modules that use the bus at first use: a rig is loaded and played without them."""
    for module in _MODULES if name in __all__ else ():
        found = getattr(import_module(f"{__name__}.{module}"), name, None)
        if found is not None:
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
