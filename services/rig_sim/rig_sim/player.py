"""A rig that plays: specimen read, compiled, proven against Drake, at rest; drives in, responses out in blocks."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig_sim.actuator_use import Use, UseMeter
from rig_sim.assembly import assemble
from rig_sim.compile.model import CompiledModel, compile_model
from rig_sim.documents import document_files
from rig_sim.drake_engine import DrakeEngine
from rig_sim.engine import Engine, EngineChoice, Player
from rig_sim.equilibrium import find_equilibrium
from rig_sim.faults import Fault, FaultySensors, break_specimen
from rig_sim.hydraulics.actuator import HydraulicActuator
from rig_sim.multibody.drake_reader import load_plant, read_tree
from rig_sim.poses import Poses
from rig_sim.proof import Proof, prove
from rig_sim.rig_model import RigModel
from rig_sim.specimen import Specimen, SpecimenError, load_specimen
from rig_sim.stability import check_stability
from rig_sim.step_check import check_step
from rig_sim.watchdogs import Watchdog, set_up_watchdogs

BLOCK_SAMPLES = 100
#: Of a block by Drake's engine: about as long on the wall clock, so that a stop is heard as soon.
DRAKE_BLOCK_SAMPLES = 20
#: Bumped whenever the same specimen may answer differently to the same drive.
_EQUATIONS_VERSION = 1
_RAMP_DOWN_SECONDS = 0.5
_HOLD_SECONDS = 0.1


class RigFaultError(RuntimeError):
    """A playback that could not be brought to its end, in one sentence."""


@dataclass(frozen=True)
class Block:
    """A piece of a playback: drive (drives, samples) and measured response (responses, samples) from `first_sample`."""

    first_sample: int
    drive: np.ndarray
    response: np.ndarray
    #: For watchdogs: command less achieved value, (drives, samples), in the drive's unit, zero where no actuator
    #: follows; and the monitored values of the elements, (values, samples), in the order of the model's outputs.
    following_error: np.ndarray | None = None
    monitored: np.ndarray | None = None


@dataclass(frozen=True)
class Rig:
    """A specimen ready to play."""

    specimen: Specimen
    model: RigModel
    compiled: CompiledModel
    engine: EngineChoice
    #: The engine at work: what advances a playback.
    player: Player
    proof: Proof
    #: State at rest with all drives zero; every playback starts here.
    rest: np.ndarray
    #: Responses at rest, (responses,), without noise.
    static_response: np.ndarray
    #: SHA-256 of everything that decides what the rig answers to a drive.
    content_hash: str
    #: Forward kinematics, for a view.
    poses: Poses
    watchdogs: tuple[Watchdog, ...] = ()
    #: Injected for tests and rehearsals.
    faults: tuple[Fault, ...] = ()

    @property
    def engine_name(self) -> str:
        """What plays."""
        return self.engine.engine.value

    @property
    def block_samples(self) -> int:
        """Samples of every block of a playback but the last."""
        return DRAKE_BLOCK_SAMPLES if self.engine.engine is Engine.DRAKE else BLOCK_SAMPLES

    def playback(self, drive: np.ndarray, *, seed: int) -> Playback:
        """Return a playback of a checked drive (drives, samples) that has not begun yet."""
        return Playback(self, drive, seed=seed)


def load_rig(
    path: Path,
    engine: EngineChoice = EngineChoice(),  # noqa: B008 - frozen
    *,
    faults: Sequence[Fault] = (),
) -> Rig:
    """Load a rig from its YAML: read, assemble, compile, prove, find the rest; then take the engine that plays.

    Raises
    ------
    SpecimenError, NoEquilibriumError, UnstableError, StepError, ProofError
        Where the specimen cannot be used; one sentence each.
    """
    specimen = break_specimen(load_specimen(path), faults)
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
    check_stability(compiled.derivative, rest, still, model.state_names)
    if engine.engine is Engine.COMPILED:  # Drake controls its own steps
        check_step(compiled.derivative, rest, still, names=model.state_names, specimen=specimen)
    static = compiled.outputs(rest, still)[: len(specimen.responses)]
    digest = hashlib.sha256(f"equations {_EQUATIONS_VERSION}\nengine {engine.model_dump_json()}\n".encode())
    for file in (sdf, *document_files(path)):
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    for fault in faults:
        digest.update(fault.model_dump_json().encode())
    player = DrakeEngine(model, plant, engine) if engine.engine is Engine.DRAKE else compiled
    return Rig(
        specimen=specimen,
        model=model,
        compiled=compiled,
        engine=engine,
        player=player,
        proof=proof,
        rest=rest,
        static_response=static,
        content_hash=digest.hexdigest(),
        poses=Poses(tree),
        watchdogs=_watchdogs(specimen, model),
        faults=tuple(faults),
    )


def _watchdogs(specimen: Specimen, model: RigModel) -> tuple[Watchdog, ...]:
    elements = model.assembly.elements
    try:
        return set_up_watchdogs(
            specimen.watchdogs,
            responses={channel.name: channel.unit for channel in specimen.responses},
            drives={channel.name: channel.unit for channel in specimen.drives},
            followed=[element.name for element in elements if isinstance(element, HydraulicActuator)],
            monitored=model.output_names[len(specimen.responses) :],
        )
    except ValueError as error:
        raise SpecimenError(f"specimen {specimen.name}: {error}") from error


class Playback:
    """One playback under way: iterate over `blocks()` to its end, then read `response` and `uses()`."""

    def __init__(self, rig: Rig, drive: np.ndarray, *, seed: int) -> None:
        self._rig = rig
        self._drive = np.ascontiguousarray(drive, dtype=np.float64)
        self._state = rig.rest.copy()
        self._noise = np.random.default_rng(seed)
        self._noise_rms = np.array([channel.noise_rms for channel in rig.specimen.responses])[:, None]
        self._sensors = FaultySensors(
            rig.faults,
            channels=rig.model.response_names,
            sample_rate=rig.specimen.sample_rate,
            seed=seed,
        )
        #: May be made smaller before it plays; the bytes of the compiled player do not depend on it.
        self.block_samples = rig.block_samples
        self._actuators = [element for element in rig.model.assembly.elements if isinstance(element, HydraulicActuator)]
        self._meter = UseMeter(self._actuators, drives=rig.model.input_names, outputs=rig.player.output_names)
        self._bounds = self._state_bounds()
        self.response = np.empty((len(rig.specimen.responses), self._drive.shape[1]))
        self.samples_done = 0

    @property
    def positions(self) -> np.ndarray:
        """Drake's positions (n_q,) after what is played so far."""
        return self._state[: self._rig.model.position_count]

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
            end = min(first + self.block_samples, samples)
            piece = self._drive[:, first:end]
            block = self._advance(np.hstack([piece, self._drive_at(end)]), first)
            self.response[:, first:end] = block.response
            self.samples_done = end
            yield block

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
        for begin in range(0, len(shape) - 1, self.block_samples):
            end = min(begin + self.block_samples, len(shape) - 1)
            yield self._advance(ramp[:, begin : end + 1], self.samples_done + begin)

    def uses(self) -> list[Use]:
        """Return how every drive channel was used so far."""
        played = self._drive[:, : max(self.samples_done, 1)]
        ratios = []
        for index, channel in enumerate(self._rig.specimen.drives):
            up, down = played[index].max(), played[index].min()
            ratios.append(max(up / channel.maximum if up > 0 else 0.0, down / channel.minimum if down < 0 else 0.0))
        return self._meter.uses(ratios, samples=self.samples_done)

    def _drive_at(self, sample: int) -> np.ndarray:
        """Return one column of the drive, the last one where it has ended."""
        column = min(sample, self._drive.shape[1] - 1)
        return self._drive[:, column : column + 1]

    def _advance(self, commands: np.ndarray, first: int) -> Block:
        """Play the columns of `commands` but the last, which they lead to; return them with what the sensors say."""
        rig = self._rig
        played = rig.player.play(
            self._state,
            commands,
            sample_interval=1.0 / rig.specimen.sample_rate,
            substeps=rig.specimen.substeps,
            bounds=self._bounds,
        )
        if played.diverged_at is not None:
            raise RigFaultError(self._explain(played.diverged_states, first + played.diverged_at))
        self._state = played.state
        following_error = self._meter.count(commands[:, :-1], played.outputs)
        responses = len(rig.specimen.responses)
        # One row of noise a sample: the same numbers however the record is cut into blocks.
        noise = self._noise.standard_normal((played.outputs.shape[1], responses)).T
        measured = played.outputs[:responses] + self._noise_rms * noise
        return Block(
            first_sample=first,
            drive=commands[:, :-1],
            response=self._sensors.spoil(first, measured),
            following_error=following_error,
            monitored=played.outputs[responses:],
        )

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
