"""A rig's part of the contract: interlock, playback with its signal stream, poses, view and FRF."""

from rig_sim.bus.frf_query import answer_frf
from rig_sim.bus.interlock import Interlock
from rig_sim.bus.playback_session import PlaybackSession, published_samples
from rig_sim.bus.view_messages import describe_view

__all__ = [
    "Interlock",
    "PlaybackSession",
    "answer_frf",
    "describe_view",
    "published_samples",
]
