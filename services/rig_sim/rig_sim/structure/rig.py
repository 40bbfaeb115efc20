"""A structure that plays: force in, acceleration out, block by block, exact at every sample."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig_sim.player import BLOCK_SAMPLES, Block, Use
from rig_sim.specimen import SpecimenError, read_specimen
from rig_sim.structure.finite_elements import find_modes
from rig_sim.structure.modal_model import Complex, ModalModel, SampledModel
from rig_sim.structure.specimen import StructureSpecimen

#: Bumped whenever the same specimen may answer differently to the same drive.
_EQUATIONS_VERSION = 1
_RAMP_DOWN_SECONDS = 0.5
_HOLD_SECONDS = 0.1


@dataclass(frozen=True)
class StructureRig:
    """A structure ready to play."""

    specimen: StructureSpecimen
    modes: ModalModel
    sampled: SampledModel
    #: SHA-256 of everything that decides what the rig answers to a drive.
    content_hash: str

    @property
    def engine_name(self) -> str:
        """What plays."""
        return "state space"

    @property
    def block_samples(self) -> int:
        """Samples of every block of a playback but the last."""
        return BLOCK_SAMPLES

    @property
    def static_response(self) -> np.ndarray:
        """Responses at rest (responses,): an accelerometer shows nothing then."""
        return np.zeros(len(self.specimen.responses))

    def playback(self, drive: np.ndarray, *, seed: int) -> StructurePlayback:
        """Return a playback of a checked drive (drives, samples) that has not begun yet."""
        return StructurePlayback(self, drive, seed=seed)

    def sampled_frf(self, frequency: np.ndarray) -> Complex:
        """Return the FRF of what it plays (lines, responses, drives) at frequencies (lines,) in Hz."""
        return self.modes.sampled_frf(frequency, self.specimen.sample_rate)


def load_structure(path: Path) -> StructureRig:
    """Load a structure from its YAML.

    Raises
    ------
    SpecimenError
        Where it cannot be used; one sentence.
    """
    specimen = read_specimen(path, StructureSpecimen)
    try:
        modes = find_modes(specimen)
    except ValueError as error:
        raise SpecimenError(f"specimen {specimen.name}: {error}") from error
    digest = hashlib.sha256(f"state space {_EQUATIONS_VERSION}\n".encode())
    digest.update(path.read_bytes())
    return StructureRig(specimen, modes, modes.sampled(specimen.sample_rate), digest.hexdigest())


class StructurePlayback:
    """One playback under way: iterate over `blocks()` to its end, then read `response` and `uses()`."""

    def __init__(self, rig: StructureRig, drive: np.ndarray, *, seed: int) -> None:
        self._rig = rig
        self._drive = np.ascontiguousarray(drive, dtype=np.float64)
        model = rig.sampled
        # One product a sample, always of the same shape: the same bits however the record is cut into blocks.
        self._step = np.block([[model.a, model.b0, model.b1], [model.c, model.d, np.zeros_like(model.d)]])
        self._states = len(model.a)
        self._noise = np.random.default_rng(seed)
        self._noise_rms = np.array([channel.noise_rms for channel in rig.specimen.responses])
        # The force begins at the first sample; a structure has no past.
        self._state = np.zeros(self._states)
        self.response = np.empty((len(rig.specimen.responses), self._drive.shape[1]))
        self.samples_done = 0

    def blocks(self) -> Iterator[Block]:
        """Play on, block by block; the last one may be shorter."""
        samples = self._drive.shape[1]
        while self.samples_done < samples:
            first = self.samples_done
            end = min(first + BLOCK_SAMPLES, samples)
            piece = self._drive[:, first:end]
            response = self._advance(np.hstack([piece, self._drive_at(end)]))
            self.response[:, first:end] = response
            self.samples_done = end
            yield Block(first, piece, response)

    def ramp_down(self) -> Iterator[Block]:
        """From where the playback was left, bring all forces to zero along a cosine and hold; it rings on."""
        rate = self._rig.specimen.sample_rate
        fall = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, round(_RAMP_DOWN_SECONDS * rate) + 1)))
        shape = np.concatenate([fall[:-1], np.zeros(round(_HOLD_SECONDS * rate) + 1)])
        start = self._drive_at(self.samples_done) if self.samples_done else np.zeros((len(self._drive), 1))
        ramp = start * shape
        for begin in range(0, len(shape) - 1, BLOCK_SAMPLES):
            end = min(begin + BLOCK_SAMPLES, len(shape) - 1)
            response = self._advance(ramp[:, begin : end + 1])
            yield Block(self.samples_done + begin, ramp[:, begin:end], response)

    def uses(self) -> list[Use]:
        """Return how every shaker was used so far: its peak; a force has no valve and nothing to follow."""
        played = self._drive[:, : max(self.samples_done, 1)]
        uses = []
        for channel, row in zip(self._rig.specimen.drives, played, strict=True):
            up, down = row.max(), row.min()
            ratio = max(up / channel.maximum if up > 0 else 0.0, down / channel.minimum if down < 0 else 0.0)
            uses.append(Use(channel.name, float(ratio), 0.0, 0.0))
        return uses

    def _drive_at(self, sample: int) -> np.ndarray:
        """Return one column of the drive, the last one where it has ended."""
        column = min(sample, self._drive.shape[1] - 1)
        return self._drive[:, column : column + 1]

    def _advance(self, forces: np.ndarray) -> np.ndarray:
        """Play the columns of `forces` but the last, which they lead to; return what the sensors say."""
        count, states = forces.shape[1] - 1, self._states
        # State, force now and force at the next sample, side by side: what one step is made of.
        own = np.concatenate([self._state, np.zeros(2 * len(forces))])
        following = np.ascontiguousarray(np.vstack([forces[:, :-1], forces[:, 1:]]).T)
        measured = np.empty((count, len(self._noise_rms)))
        for sample in range(count):
            own[states:] = following[sample]
            step = self._step @ own
            own[:states] = step[:states]
            measured[sample] = step[states:]
        self._state = own[:states]
        return (measured + self._noise_rms * self._noise.standard_normal(measured.shape)).T
