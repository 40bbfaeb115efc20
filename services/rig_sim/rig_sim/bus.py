"""A simulated rig behind the gateway: its description in the contract's terms, and its playbacks."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from duralab_bus import Metrics
from duralab_gateway import PlaybackRig, Run
from duralab_gateway.motion import DrivePlayback, RigFaultError, to_poses
from duralab_proto.arrays import to_array
from duralab_proto.v1 import array_pb2, rig_pb2
from rig_sim.checks import ProofError
from rig_sim.loading import PlayableRig
from rig_sim.playing import Lost, Playback, Rig, WearFile, WearState, gain_changes, lost_by
from rig_sim.specimen import InputChannel, Quantity
from rig_sim.structure import StructureRig

#: Number of blocks that a simulation ahead of the clock publishes as one.
_BLOCKS_TOGETHER = 6


def describe_rig(rig: PlayableRig) -> rig_pb2.RigDescription:
    """Return the description of a simulated rig, with the shapes of a multibody rig."""
    specimen = rig.specimen
    description = rig_pb2.RigDescription(
        rig=specimen.name,
        specimen=specimen.title + (_wear_suffix(rig) if isinstance(rig, Rig) else ""),
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
        simulated=True,
    )
    if isinstance(rig, Rig):
        description.MergeFrom(rig.geometry)
        rest = rig.poses.frames(rig.rest[None, : rig.model.position_count])
        description.rest_poses.CopyFrom(to_array(to_poses(rest)[0]))
    return description


def _wear_suffix(rig: Rig) -> str:
    """Return the suffix of the description for wear, which is the same before the first run and after the last."""
    return f" [{rig.mounted}, WEARS: {', '.join(wear.name for wear in rig.specimen.wear)}]" if rig.wears else ""


class SimulatedRig(PlaybackRig):
    """A rig of this simulator, at rest, behind a gateway; it needs no stop and no preparation.

    A rig that wears keeps its state in a folder, or in memory if there is none. Raises `SpecimenError` if a state
    in the folder is of another rig.
    """

    def __init__(self, rig: PlayableRig, *, wear_folder: Path | None = None) -> None:
        self._rig = rig
        #: Wear of the specimen so far.
        self.wear = WearState()
        self._wear_file: WearFile | None = None
        if isinstance(rig, Rig) and rig.wears and wear_folder is not None:
            self._wear_file = WearFile(wear_folder, rig=rig.specimen.name, specimen=rig.mounted)
            self.wear = self._wear_file.read({part.name for part in rig.model.assembly.wearing})
        self.approach = rig.specimen.approach
        self.watchdogs = rig.watchdogs
        if isinstance(rig, StructureRig):
            # A rig with this attribute states its FRF.
            self.sampled_frf = rig.sampled_frf

    def describe(self) -> rig_pb2.RigDescription:
        """Return the description of the rig."""
        return describe_rig(self._rig)

    def playback(self, drive: np.ndarray, run: Run) -> DrivePlayback:
        """Return a playback of a checked drive."""
        self.prove()
        if not isinstance(self._rig, Rig) or not self._rig.wears:
            return self._rig.playback(drive, seed=run.seed)
        condition = self._rig.condition(self.wear)
        return self._rig.playback(drive, seed=run.seed, condition=condition, at_end=self._wear_on)

    def prove(self) -> None:
        """Wait for the proof of a multibody rig; raises `RigFaultError` if it must not play."""
        if isinstance(self._rig, Rig):
            try:
                self._rig.late_proof.result()
            except ProofError as error:
                raise RigFaultError(str(error)) from error

    def reset(self) -> None:
        """Refuse a reset of a rig that must not play."""
        self.prove()

    def follow_wear(self, metrics: Metrics) -> None:
        """Register gauges of the wear, if there is any."""
        rig = self._rig
        if not isinstance(rig, Rig) or not rig.wears:
            return
        name, parts = rig.specimen.name, rig.model.assembly.wearing

        def lost() -> dict[tuple[str, ...], float]:
            shares = lost_by(parts, self.wear).items()
            return {(name, part, what): getattr(share, what) for part, share in shares for what in Lost.model_fields}

        metrics.follow(
            "duralab_rig_wear_runs", "Runs of the specimen", lambda: {(name,): float(self.wear.runs)}, labels=("rig",)
        )
        metrics.follow(
            "duralab_rig_wear_damage",
            "Miner sum of a part that wears",
            lambda: {(name, part.name): self.wear.damage.get(part.name, 0.0) for part in parts},
            labels=("rig", "part"),
        )
        metrics.follow(
            "duralab_rig_wear_lost_ratio", "Share that a part has lost", lost, labels=("rig", "part", "property")
        )
        metrics.follow(
            "duralab_rig_wear_gain_change_ratio",
            "Change of a sensor's gain",
            lambda: {(name, channel): change for channel, change in gain_changes(rig.model, self.wear).items()},
            labels=("rig", "channel"),
        )

    def _wear_on(self, playback: Playback) -> None:
        assert isinstance(self._rig, Rig)
        state = self._rig.worn(self.wear, playback)
        if self._wear_file is not None:
            try:
                self._wear_file.write(state)
            except OSError as error:
                raise RigFaultError(
                    f"the wear of {self._rig.specimen.name} cannot be written to {self._wear_file.path.name}: "
                    f"{error.strerror}; make room, for the specimen has worn and the next run must know."
                ) from error
        self.wear = state


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
        actuator_speed=channel.actuator_speed,
        label=channel.label,
        # Displacement control holds the specimen in place; a constant force moves a free specimen without limit.
        holds_static=channel.quantity is Quantity.DISPLACEMENT,
    )
