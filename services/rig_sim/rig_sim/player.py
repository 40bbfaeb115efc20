"""A rig that plays: specimen read, compiled, proven against Drake, at rest; drives in, responses out in blocks."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig_sim.assembly import assemble
from rig_sim.compile.model import CompiledModel, compile_model
from rig_sim.equilibrium import find_equilibrium
from rig_sim.hydraulics.actuator import DisplacementActuator
from rig_sim.multibody.drake_reader import load_plant, read_tree
from rig_sim.proof import Proof, prove
from rig_sim.rig_model import RigModel
from rig_sim.specimen import Specimen, SpecimenError, load_specimen

BLOCK_SAMPLES = 100
#: Bumped whenever the same specimen may answer differently to the same drive.
_EQUATIONS_VERSION = 1
_RAMP_DOWN_SECONDS = 0.5
_HOLD_SECONDS = 0.1
#: From this share of the largest load pressure on, an actuator counts as saturated: little flow is left to move it.
_FULL_LOAD_PRESSURE = 0.95


class RigFaultError(RuntimeError):
    """A playback that could not be brought to its end, in one sentence."""


@dataclass(frozen=True)
class Block:
    """A piece of a playback: drive (drives, samples) and measured response (responses, samples) from `first_sample`."""

    first_sample: int
    drive: np.ndarray
    response: np.ndarray


@dataclass(frozen=True)
class Use:
    """How one drive channel used its actuator: shares 0 to 1, the following error in the drive's unit.

    A drive that moves no actuator (a road) has a peak and nothing else.
    """

    drive: str
    peak_command_ratio: float
    saturated_share: float
    largest_following_error: float


@dataclass(frozen=True)
class Rig:
    """A specimen ready to play."""

    specimen: Specimen
    model: RigModel
    compiled: CompiledModel
    proof: Proof
    #: State at rest with all drives zero; every playback starts here.
    rest: np.ndarray
    #: Responses at rest, (responses,), without noise.
    static_response: np.ndarray
    #: SHA-256 of everything that decides what the rig answers to a drive.
    content_hash: str

    def playback(self, drive: np.ndarray, *, seed: int) -> Playback:
        """Return a playback of a checked drive (drives, samples) that has not begun yet."""
        return Playback(self, drive, seed=seed)


def load_rig(path: Path) -> Rig:
    """Load a rig from its YAML: read, assemble, compile, prove, find the rest.

    Raises
    ------
    SpecimenError, NoEquilibriumError, ProofError
        Where the specimen cannot be used; one sentence each.
    """
    specimen = load_specimen(path)
    sdf = path.with_name(specimen.sdf)
    try:
        plant = load_plant(sdf)
        tree = read_tree(plant)
    except ValueError as error:
        raise SpecimenError(f"specimen {specimen.name}: {error}") from error
    model = RigModel(assemble(specimen, tree))
    compiled = compile_model(
        model.traced, state_names=model.state_names, input_names=model.input_names, output_names=model.output_names
    )
    proof = prove(model, compiled, plant)
    still = np.zeros(len(specimen.drives))
    rest = find_equilibrium(model, compiled.derivative, still)
    static = compiled.outputs(rest, still)[: len(specimen.responses)]
    digest = hashlib.sha256(f"equations {_EQUATIONS_VERSION}\n".encode())
    for content in (sdf.read_bytes(), path.read_bytes()):
        digest.update(hashlib.sha256(content).digest())
    return Rig(specimen, model, compiled, proof, rest, static, digest.hexdigest())


@dataclass(frozen=True)
class _Monitor:
    """Where an actuator's drive and monitored values are in the player's inputs and outputs."""

    drive: int
    stroke: int
    valve_command: int
    load_pressure: int


class Playback:
    """One playback under way: iterate over `blocks()` to its end, then read `response` and `uses()`."""

    def __init__(self, rig: Rig, drive: np.ndarray, *, seed: int) -> None:
        self._rig = rig
        self._drive = np.ascontiguousarray(drive, dtype=np.float64)
        self._state = rig.rest.copy()
        self._noise = np.random.default_rng(seed)
        self._noise_rms = np.array([channel.noise_rms for channel in rig.specimen.responses])[:, None]
        self._actuators = [
            element for element in rig.model.assembly.elements if isinstance(element, DisplacementActuator)
        ]
        self._monitors = self._find_monitors()
        self._saturated = np.zeros(len(rig.specimen.drives))
        self._following = np.zeros(len(rig.specimen.drives))
        self._bounds = self._state_bounds()
        self.response = np.empty((len(rig.specimen.responses), self._drive.shape[1]))
        self.samples_done = 0

    def blocks(self) -> Iterator[Block]:
        """Play on, block by block; the last one may be shorter.

        Raises
        ------
        RigFaultError
            Where a piston meets its end stop or the motion is no longer finite; names it and the time.
        """
        samples = self._drive.shape[1]
        while self.samples_done < samples:
            first = self.samples_done
            end = min(first + BLOCK_SAMPLES, samples)
            piece = self._drive[:, first:end]
            response = self._advance(np.hstack([piece, self._drive_at(end)]), first)
            self.response[:, first:end] = response
            self.samples_done = end
            yield Block(first, piece, response)

    def ramp_down(self) -> Iterator[Block]:
        """From where the playback was left, bring all drives to zero along a cosine and hold; blocks count on.

        Raises
        ------
        RigFaultError
            As `blocks`.
        """
        rate = self._rig.specimen.sample_rate
        fall = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, round(_RAMP_DOWN_SECONDS * rate) + 1)))
        # Zero exactly from the end of the ramp on; the last column is only looked ahead to.
        shape = np.concatenate([fall[:-1], np.zeros(round(_HOLD_SECONDS * rate) + 1)])
        # The player is already on its way to the next sample. Before the first one it is at rest.
        start = self._drive_at(self.samples_done) if self.samples_done else np.zeros((len(self._drive), 1))
        ramp = start * shape
        for begin in range(0, len(shape) - 1, BLOCK_SAMPLES):
            end = min(begin + BLOCK_SAMPLES, len(shape) - 1)
            first = self.samples_done + begin
            yield Block(first, ramp[:, begin:end], self._advance(ramp[:, begin : end + 1], first))

    def uses(self) -> list[Use]:
        """Return how every drive channel was used so far."""
        played = self._drive[:, : max(self.samples_done, 1)]
        uses = []
        for index, channel in enumerate(self._rig.specimen.drives):
            up, down = played[index].max(), played[index].min()
            ratio = max(up / channel.maximum if up > 0 else 0.0, down / channel.minimum if down < 0 else 0.0)
            share = self._saturated[index] / max(self.samples_done, 1)
            uses.append(Use(channel.name, float(ratio), float(share), float(self._following[index])))
        return uses

    def _drive_at(self, sample: int) -> np.ndarray:
        """Return one column of the drive, the last one where it has ended."""
        column = min(sample, self._drive.shape[1] - 1)
        return self._drive[:, column : column + 1]

    def _advance(self, commands: np.ndarray, first: int) -> np.ndarray:
        """Play the columns of `commands` but the last, which they lead to; return what the sensors say."""
        rig = self._rig
        played = rig.compiled.play(
            self._state,
            commands,
            sample_interval=1.0 / rig.specimen.sample_rate,
            substeps=rig.specimen.substeps,
            bounds=self._bounds,
        )
        if played.diverged_at is not None:
            raise RigFaultError(self._explain(played.diverged_states, first + played.diverged_at))
        self._state = played.state
        for monitor in self._monitors:
            valve = np.abs(played.outputs[monitor.valve_command])
            load = np.abs(played.outputs[monitor.load_pressure])
            self._saturated[monitor.drive] += np.count_nonzero((valve >= 1.0) | (load >= _FULL_LOAD_PRESSURE))
            error = np.max(np.abs(commands[monitor.drive, :-1] - played.outputs[monitor.stroke]))
            self._following[monitor.drive] = max(self._following[monitor.drive], error)
        responses = len(rig.specimen.responses)
        # One row of noise a sample: the same numbers however the record is cut into blocks.
        noise = self._noise.standard_normal((played.outputs.shape[1], responses)).T
        return played.outputs[:responses] + self._noise_rms * noise

    def _find_monitors(self) -> list[_Monitor]:
        drives, outputs = self._rig.model.input_names, self._rig.compiled.output_names
        return [
            _Monitor(
                drive=drives.index(actuator.name),
                stroke=outputs.index(f"{actuator.name}.stroke"),
                valve_command=outputs.index(f"{actuator.name}.valve_command"),
                load_pressure=outputs.index(f"{actuator.name}.load_pressure"),
            )
            for actuator in self._actuators
        ]

    def _state_bounds(self) -> np.ndarray:
        bounds = np.full(len(self._state), np.finfo(float).max)
        for actuator in self._actuators:
            bounds[actuator.joint_position] = actuator.cylinder.half_stroke
        return bounds

    def _explain(self, states: tuple[str, ...], sample: int) -> str:
        seconds = sample / self._rig.specimen.sample_rate
        names = self._rig.model.state_names
        ended = [actuator for actuator in self._actuators if names[actuator.joint_position] in states]
        if len(ended) == len(states):
            pistons = " and ".join(
                f"the piston of {actuator.name} met its end stop ({1000 * actuator.cylinder.half_stroke:.0f} mm)"
                for actuator in ended
            )
            return f"{pistons} at {seconds:.3f} s; lower the drive."
        return (
            f"the motion of {self._rig.specimen.name} became unbounded at {seconds:.3f} s, among others in "
            f"{states[0]!r}; lower the drive or take more substeps."
        )
