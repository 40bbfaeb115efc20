"""What makes any rig a rig on the bus: checks, playback, stop and latch, streams. A rig is a class of four methods."""

from importlib import import_module
from typing import TYPE_CHECKING

from duralab_gateway.motion import Approach, Block, DrivePlayback, RigFaultError, Use, Watchdog

if TYPE_CHECKING:
    from duralab_gateway.description import check_drive, complete_description
    from duralab_gateway.gateway_process import GatewayConfig, open_spools, serve, serving
    from duralab_gateway.rig import KnowsItsFrf, Phase, PlaybackRig, Rig, Run, ShowsFrames, StepwiseRig
    from duralab_gateway.server import SERVICE, RigServer, answer_frf, serve_refusal

__all__ = [
    "SERVICE",
    "Approach",
    "Block",
    "DrivePlayback",
    "GatewayConfig",
    "KnowsItsFrf",
    "Phase",
    "PlaybackRig",
    "Rig",
    "RigFaultError",
    "RigServer",
    "Run",
    "ShowsFrames",
    "StepwiseRig",
    "Use",
    "Watchdog",
    "answer_frf",
    "check_drive",
    "complete_description",
    "open_spools",
    "serve",
    "serve_refusal",
    "serving",
]

_MODULE_OF = {
    "complete_description": "description",
    "check_drive": "drive_check",
    "answer_frf": "frf_query",
    "GatewayConfig": "gateway_process",
    "open_spools": "gateway_process",
    "serve": "gateway_process",
    "serving": "gateway_process",
    "KnowsItsFrf": "rig",
    "Phase": "rig",
    "PlaybackRig": "rig",
    "Rig": "rig",
    "Run": "rig",
    "ShowsFrames": "rig",
    "StepwiseRig": "rig",
    "SERVICE": "server",
    "RigServer": "server",
    "serve_refusal": "server",
}


def __getattr__(name: str) -> object:
    """Import what talks to the bus when it is first used: a rig is loaded and played without one."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
