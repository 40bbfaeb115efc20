"""A simulated rig as the gateway serves it: its description in the contract's words, and its playbacks."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np

from duralab_gateway import Run
from duralab_gateway.motion import Approach, DrivePlayback, Watchdog
from duralab_proto.arrays import to_array
from duralab_proto.v1 import array_pb2, rig_pb2
from rig_sim.bus.view_messages import describe_view
from rig_sim.playing import KnowsItsFrf, PlayableRig, PlayableSpecimen, Rig
from rig_sim.specimen import InputChannel, Quantity

#: A simulation that runs ahead of the clock publishes so many blocks as one.
_BLOCKS_TOGETHER = 4

_KINDS = {
    Quantity.ACCELERATION: array_pb2.CHANNEL_KIND_ACCELERATION,
    Quantity.DISPLACEMENT: array_pb2.CHANNEL_KIND_DISPLACEMENT,
    Quantity.FORCE: array_pb2.CHANNEL_KIND_FORCE,
    Quantity.MOMENT: array_pb2.CHANNEL_KIND_MOMENT,
    Quantity.RATIO: array_pb2.CHANNEL_KIND_RATIO,
    Quantity.VELOCITY: array_pb2.CHANNEL_KIND_VELOCITY,
}


def describe_rig(rig: PlayableRig) -> rig_pb2.RigDescription:
    """Return what a simulated rig says of itself.

    `rig`: At rest.
    Returns: With the shapes of a multibody rig.
    """
    specimen = rig.specimen
    description = rig_pb2.RigDescription(
        rig=specimen.name,
        specimen=specimen.title,
        engine=rig.engine_name,
        version=version("duralab-rig-sim"),
        sample_rate=specimen.sample_rate,
        drives=[_drive_channel(channel) for channel in specimen.drives],
        responses=_response_channels(specimen),
        longest_drive_seconds=specimen.longest_drive,
        static_response=to_array(rig.static_response),
        block_samples=_BLOCKS_TOGETHER * rig.block_samples,
        content_hash=rig.content_hash,
    )
    if isinstance(rig, Rig):
        describe_view(rig, description)
    return description


def simulated(rig: PlayableRig) -> SimulatedRig:
    """Return a rig as the gateway serves it; one that knows its FRF says it.

    `rig`: At rest.
    Returns: With a `sampled_frf` where the rig has one.
    """
    return SimulatedLinearRig(rig) if isinstance(rig, KnowsItsFrf) else SimulatedRig(rig)


class SimulatedRig:
    """A rig of this simulator behind a gateway; it has nothing to stop and nothing to make ready.

    `rig`: At rest.
    """

    def __init__(self, rig: PlayableRig) -> None:
        self._rig = rig

    @property
    def approach(self) -> Approach:
        """Ways to the first sample and back, of its specimen."""
        return self._rig.specimen.approach

    @property
    def watchdogs(self) -> tuple[Watchdog, ...]:
        """Watchdogs of its specimen."""
        return self._rig.watchdogs

    def describe(self) -> rig_pb2.RigDescription:
        """Return what it is."""
        return describe_rig(self._rig)

    def playback(self, drive: np.ndarray, run: Run) -> DrivePlayback:
        """Return a playback of a checked drive."""
        return self._rig.playback(drive, seed=run.seed)

    def stop(self, reason: str) -> None:
        """Do nothing: the gateway ramps down."""

    def reset(self) -> None:
        """Do nothing: every playback begins at rest."""


class SimulatedLinearRig(SimulatedRig):
    """A rig of this simulator whose FRF is known in closed form."""

    def __init__(self, rig: KnowsItsFrf) -> None:
        super().__init__(rig)
        self._linear = rig

    def sampled_frf(self, frequency: np.ndarray) -> np.ndarray:
        """Return the FRF (lines, responses, drives) at frequencies (lines,) in Hz."""
        return self._linear.sampled_frf(frequency)


def _drive_channel(channel: InputChannel) -> array_pb2.Channel:
    return array_pb2.Channel(
        name=channel.name,
        unit=channel.unit,
        kind=_KINDS[channel.quantity],
        minimum=channel.minimum,
        maximum=channel.maximum,
        slew_limit=channel.slew_limit,
        label=channel.label,
    )


def _response_channels(specimen: PlayableSpecimen) -> list[array_pb2.Channel]:
    return [
        array_pb2.Channel(
            name=channel.name,
            unit=channel.unit,
            kind=_KINDS[channel.quantity],
            minimum=-channel.range,
            maximum=channel.range,
            label=channel.label,
            watchdog=specimen.watchdogs.responses.get(channel.name, 0.0),
        )
        for channel in specimen.responses
    ]
