"""What makes any rig a rig on the bus: checks, playback, stop and latch, streams. A rig is a class of four methods."""

from duralab_gateway.description import complete_description
from duralab_gateway.drive_check import check_drive
from duralab_gateway.frf_query import answer_frf
from duralab_gateway.gateway_process import GatewayConfig, open_spools, serve, serving
from duralab_gateway.motion import Approach, Block, DrivePlayback, RigFaultError, Use, Watchdog
from duralab_gateway.rig import KnowsItsFrf, Phase, PlaybackRig, Rig, Run, ShowsFrames, StepwiseRig
from duralab_gateway.server import SERVICE, RigServer, serve_refusal

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
