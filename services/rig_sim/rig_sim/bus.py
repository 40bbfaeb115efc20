"""A simulated rig as the gateway serves it: its description in the contract's words, and its playbacks."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np

from duralab_gateway import PlaybackRig, Run
from duralab_gateway.motion import DrivePlayback, to_poses
from duralab_proto.arrays import to_array
from duralab_proto.v1 import array_pb2, rig_pb2
from rig_sim.playing import Rig
from rig_sim.specimen import InputChannel, Quantity
from rig_sim.structure import PlayableRig, StructureRig

#: A simulation that runs ahead of the clock publishes so many blocks as one.
_BLOCKS_TOGETHER = 4


def describe_rig(rig: PlayableRig) -> rig_pb2.RigDescription:
    """Return what a simulated rig says of itself, with the shapes of a multibody rig."""
    specimen = rig.specimen
    description = rig_pb2.RigDescription(
        rig=specimen.name,
        specimen=specimen.title,
        engine=rig.engine_name,
        version=version("duralab-rig-sim"),
        sample_rate=specimen.sample_rate,
        drives=[_drive_channel(channel) for channel in specimen.drives],
        responses=[
            array_pb2.Channel(
                name=channel.name,
                unit=channel.unit,
                kind=_kind(channel.quantity),
                minimum=-channel.range,
                maximum=channel.range,
                label=channel.label,
                watchdog=specimen.watchdogs.responses.get(channel.name, 0.0),
            )
            for channel in specimen.responses
        ],
        longest_drive_seconds=specimen.longest_drive,
        static_response=to_array(rig.static_response),
        block_samples=_BLOCKS_TOGETHER * rig.block_samples,
        content_hash=rig.content_hash,
    )
    if isinstance(rig, Rig):
        description.MergeFrom(rig.geometry)
        rest = rig.poses.frames(rig.rest[: rig.model.position_count])
        description.rest_poses.CopyFrom(to_array(to_poses(rest[None])[0]))
    return description


class SimulatedRig(PlaybackRig):
    """A rig of this simulator, at rest, behind a gateway; it has nothing to stop and nothing to make ready."""

    def __init__(self, rig: PlayableRig) -> None:
        self._rig = rig
        self.approach = rig.specimen.approach
        self.watchdogs = rig.watchdogs
        if isinstance(rig, StructureRig):
            # A rig that has it says that it knows its FRF.
            self.sampled_frf = rig.sampled_frf

    def describe(self) -> rig_pb2.RigDescription:
        """Return what it is."""
        return describe_rig(self._rig)

    def playback(self, drive: np.ndarray, run: Run) -> DrivePlayback:
        """Return a playback of a checked drive."""
        return self._rig.playback(drive, seed=run.seed)


def _kind(quantity: Quantity) -> Any:
    return array_pb2.ChannelKind.Value(f"CHANNEL_KIND_{quantity.name}")


def _drive_channel(channel: InputChannel) -> array_pb2.Channel:
    return array_pb2.Channel(
        name=channel.name,
        unit=channel.unit,
        kind=_kind(channel.quantity),
        minimum=channel.minimum,
        maximum=channel.maximum,
        slew_limit=channel.slew_limit,
        label=channel.label,
        # A loop on displacement holds the specimen in place; a force on a loose one moves it without end.
        holds_static=channel.quantity is Quantity.DISPLACEMENT,
    )
