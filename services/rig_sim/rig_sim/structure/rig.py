"""A structure that plays: force in, acceleration out, block by block, exact at every sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from duralab_gateway.motion import Block, Use, Watchdog
from rig_sim.playing import (
    BLOCK_SAMPLES,
    Fault,
    SensorFault,
    SimulatedPlayback,
    content_hash,
    sensor_faults,
    title_suffix,
)
from rig_sim.specimen import SpecimenError, document_files, read_specimen
from rig_sim.structure.modal_model import Complex, ModalModel, SampledModel, find_modes
from rig_sim.structure.specimen import StructureSpecimen


@dataclass(frozen=True)
class StructureRig:
    """A structure ready to play; made by `load_structure`."""

    specimen: StructureSpecimen
    modes: ModalModel
    sampled: SampledModel
    content_hash: str
    watchdogs: tuple[Watchdog, ...] = ()
    faults: tuple[SensorFault, ...] = ()

    #: Name of the engine.
    engine_name = "state space"

    @property
    def block_samples(self) -> int:
        """Number of samples in every block of a playback except the last."""
        return BLOCK_SAMPLES

    @property
    def static_response(self) -> np.ndarray:
        """Responses at rest (responses,): those of accelerometers are 0."""
        return np.zeros(len(self.specimen.responses))

    def playback(self, drive: np.ndarray, *, seed: int) -> StructurePlayback:
        """Return a playback of a checked drive (drives, samples) that has not begun yet."""
        return StructurePlayback(self, drive, seed=seed)

    def sampled_frf(self, frequency: np.ndarray) -> Complex:
        """Return the FRF of the playback (lines, responses, drives) at frequencies (lines,) in Hz."""
        return self.modes.sampled_frf(frequency, self.specimen.sample_rate)


def load_structure(path: Path, faults: Sequence[Fault] = ()) -> StructureRig:
    """Load a structure from its YAML, with faults of its sensors.

    Raises `SpecimenError` if it cannot be used, or a fault is of hydraulics; one sentence.
    """
    whole = read_specimen(path, StructureSpecimen)
    broken = sensor_faults(faults, rig=whole.name, channels=[channel.name for channel in whole.responses])
    specimen = whole.model_copy(update={"title": whole.title + title_suffix(faults)})
    try:
        modes = find_modes(specimen)
    except ValueError as error:
        raise SpecimenError(f"specimen {specimen.name}: {error}") from error
    watchdogs = specimen.set_up_watchdogs()
    digest = content_hash(document_files(path), faults)
    return StructureRig(specimen, modes, modes.sampled(specimen.sample_rate), digest, watchdogs, broken)


class StructurePlayback(SimulatedPlayback):
    """A playback of a structure; read `uses()` at its end."""

    def __init__(self, rig: StructureRig, drive: np.ndarray, *, seed: int) -> None:
        super().__init__(rig.specimen, drive, seed=seed, faults=rig.faults, block_samples=rig.block_samples)
        self._rig = rig
        model = rig.sampled
        # One product per sample, always of the same shape: the same bits for any division of the record into blocks.
        self._step = np.block([[model.a, model.b0, model.b1], [model.c, model.d, np.zeros_like(model.d)]])
        self._states = len(model.a)
        self._state = np.zeros(self._states)

    def uses(self) -> list[Use]:
        """Return the use of every shaker so far: its peak; a force has no valve and no following error."""
        ratios = zip(self._rig.specimen.drives, self.peak_ratios(), strict=True)
        return [Use(channel.name, ratio, 0.0, 0.0) for channel, ratio in ratios]

    def _advance(self, commands: np.ndarray, first: int, *, counted: bool) -> Block:
        del counted
        drive = commands[:, :-1]
        return Block(
            first_sample=first,
            drive=drive,
            response=self._sensed(first, self._measured(commands)),
            following_error=np.zeros(drive.shape),
            monitored=np.empty((0, drive.shape[1])),
        )

    def _measured(self, forces: np.ndarray) -> np.ndarray:
        """Play the columns of `forces` except the last, which is only their end; return healthy sensors' readings."""
        count, states = forces.shape[1] - 1, self._states
        # State, force now and force at the next sample, side by side: the input of one step.
        own = np.concatenate([self._state, np.zeros(2 * len(forces))])
        following = np.ascontiguousarray(np.vstack([forces[:, :-1], forces[:, 1:]]).T)
        measured = np.empty((count, len(self._rig.specimen.responses)))
        for sample in range(count):
            own[states:] = following[sample]
            step = self._step @ own
            own[:states] = step[:states]
            measured[sample] = step[states:]
        self._state = own[:states]
        return measured.T
