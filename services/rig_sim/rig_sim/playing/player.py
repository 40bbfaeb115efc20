"""A rig that plays: specimen read, compiled, proven against Drake, at rest; drives in, responses out in blocks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from duralab_gateway.motion import Block, RigFaultError, Use, Watchdog, when
from rig_sim.checks import LateProof, Proof, check_stability, check_step, find_equilibrium, linearise, prove
from rig_sim.compile import CompiledModel, Run, Steps, cached_model, compile_model
from rig_sim.compile import Playback as Played
from rig_sim.engines import DrakeEngine, Engine, EngineChoice, Player
from rig_sim.hydraulics import HydraulicActuator
from rig_sim.model import RigModel, assemble
from rig_sim.multibody import load_plant, read_tree
from rig_sim.playing.faults import Fault, break_specimen
from rig_sim.playing.simulated_playback import BLOCK_SAMPLES, SimulatedPlayback
from rig_sim.playing.software import content_hash
from rig_sim.playing.use_meter import UseMeter
from rig_sim.playing.wear import (
    Condition,
    Lost,
    WearState,
    damage_of,
    gain_changes,
    gain_column,
    lost_by,
    lost_inputs,
)
from rig_sim.specimen import Specimen, SpecimenError, document_files, load_specimen

if TYPE_CHECKING:
    from duralab_proto.v1 import rig_pb2
    from rig_sim.view import Poses

#: Name of the mounted specimen if none is named.
FIRST_SPECIMEN = "specimen_1"
#: Samples in a block by Drake's engine: about as long in wall-clock time, so that a stop takes effect as soon.
DRAKE_BLOCK_SAMPLES = 20


@dataclass(frozen=True)
class Rig:
    """A specimen ready to play; made by `load_rig`.

    Parameters
    ----------
    specimen : Specimen
        Specimen from its YAML.
    model : RigModel
        Equations of the specimen.
    compiled : CompiledModel
        Machine code of the equations.
    engine : EngineChoice
        Engine that integrates them.
    player : Player
        Running engine that advances a playback.
    late_proof : LateProof
        Comparison of the equations with Drake's; see `proof`.
    rest : ndarray, shape (states,)
        State at rest with all drives zero; every playback starts here.
    static_response : ndarray, shape (responses,)
        Responses at rest, without noise.
    content_hash : str
        SHA-256 of everything that determines the response of the rig while its specimen is new, without its wear.
    poses : Poses
        Forward kinematics for a view.
    geometry : rig_pb2.RigDescription
        Bodies, shapes and links of its description, for a view.
    watchdogs : tuple of Watchdog
        Watchdogs that stop a playback.
    faults : tuple of Fault
        Faults injected for tests and rehearsals.
    mounted : str
        Name of the mounted specimen of its kind.
    """

    specimen: Specimen
    model: RigModel
    compiled: CompiledModel
    engine: EngineChoice
    player: Player
    late_proof: LateProof
    rest: np.ndarray
    static_response: np.ndarray
    content_hash: str
    poses: Poses
    geometry: rig_pb2.RigDescription
    watchdogs: tuple[Watchdog, ...] = ()
    faults: tuple[Fault, ...] = ()
    mounted: str = FIRST_SPECIMEN

    @property
    def proof(self) -> Proof:
        """Largest differences between the equations and Drake's; raises `ProofError` if they are too large to play."""
        return self.late_proof.result()

    @property
    def engine_name(self) -> str:
        """Name of the engine that plays."""
        return self.engine.engine.value

    @property
    def block_samples(self) -> int:
        """Number of samples in every block of a playback except the last."""
        return DRAKE_BLOCK_SAMPLES if self.engine.engine is Engine.DRAKE else BLOCK_SAMPLES

    @property
    def steps(self) -> Steps:
        """Method of a fixed step."""
        specimen = self.specimen
        return Steps(sample_interval=1.0 / specimen.sample_rate, substeps=specimen.substeps, method=specimen.integrator)

    @property
    def wears(self) -> bool:
        """Whether the specimen wears."""
        return bool(self.specimen.wear)

    def playback(
        self,
        drive: np.ndarray,
        *,
        seed: int,
        condition: Condition | None = None,
        at_end: Callable[[Playback], None] = lambda _playback: None,
    ) -> Playback:
        """Return a playback that has not begun yet.

        Parameters
        ----------
        drive : ndarray, shape (drives, samples)
            Checked drive, each row in its channel's unit.
        seed : int
            Seed of the sensors' noise.
        condition : Condition, optional
            Losses of the specimen; as new if not given. See `condition` and `changed`.
        at_end : callable
            Called with the playback when its run is over, regardless of how it ended.

        Returns
        -------
        Playback
            Playback whose blocks have to be iterated over.

        Raises
        ------
        ProofError
            The code disagrees with Drake; see `proof`, which is waited for.
        """
        self.late_proof.result()
        return Playback(self, drive, seed=seed, condition=condition or self._as_new, at_end=at_end)

    @property
    def _as_new(self) -> Condition:
        inputs = len(self.model.input_names) - len(self.model.drive_names)
        return Condition(np.zeros(inputs), np.ones((len(self.specimen.responses), 1)), self.rest)

    def condition(self, state: WearState) -> Condition:
        """Return the condition of the specimen in a state of wear.

        Parameters
        ----------
        state : WearState
            `WearState()` for a new specimen, or the state after a run, see `worn`.

        Returns
        -------
        Condition
            Condition for `playback`.

        Raises
        ------
        NoEquilibriumError
            The worn specimen has no equilibrium.
        """
        return self.changed(lost_by(self.model.assembly.wearing, state), gain_changes(self.model, state))

    def changed(
        self, lost: Mapping[str, Lost] = MappingProxyType({}), gains: Mapping[str, float] = MappingProxyType({})
    ) -> Condition:
        """Return a specimen with the given losses, regardless of its laws of wear; for studies of detection.

        Parameters
        ----------
        lost : mapping of str to Lost
            Shares lost, by the name of the wear; a part that is left out is as new.
        gains : mapping of str to float
            Share by which the gain of a response's sensor has changed, by its name.

        Returns
        -------
        Condition
            Condition for `playback`.

        Raises
        ------
        SpecimenError
            A part that does not wear, or a response that does not exist.
        NoEquilibriumError
            The specimen has no equilibrium.
        """
        inputs = lost_inputs(self.model, lost)
        still = np.concatenate([np.zeros(len(self.model.drive_names)), inputs])
        # From the rest of the new specimen, never of the last run: the result depends on the state only.
        rest = (
            find_equilibrium(self.model, self.compiled.derivative, still, start=self.rest)
            if inputs.any()
            else self.rest
        )
        return Condition(inputs, gain_column(self.model, gains), rest)

    def worn(self, state: WearState, playback: Playback) -> WearState:
        """Return the state of wear after a run.

        Parameters
        ----------
        state : WearState
            State before the run.
        playback : Playback
            Playback of this rig, up to its end or fault.

        Returns
        -------
        WearState
            State with the damage of all played samples, including ramps.
        """
        damage = {
            part.name: state.damage.get(part.name, 0.0) + damage_of(part, load)
            for part, load in zip(self.model.assembly.wearing, playback.loads(), strict=True)
        }
        hours = state.hours + playback.samples_moved / self.specimen.sample_rate / 3600.0
        return WearState(runs=state.runs + 1, hours=hours, damage=damage)


def load_rig(
    path: Path,
    engine: EngineChoice = EngineChoice(),  # noqa: B008 - frozen
    *,
    faults: Sequence[Fault] = (),
    mounted: str = FIRST_SPECIMEN,
    prove_later: bool = False,
) -> Rig:
    """Load a rig from its YAML: read, assemble, compile, prove, find the rest; then create its engine.

    Parameters
    ----------
    path : Path
        The YAML; the files that it names are in its folder.
    engine : EngineChoice
        Engine that integrates the model.
    faults : sequence of Fault
        Faults injected for tests and rehearsals.
    mounted : str
        Name of the mounted specimen of its kind; part of the content hash if it wears.
    prove_later : bool
        Whether the proof is made at its first use, at the latest by the first playback.

    Returns
    -------
    Rig
        Rig at rest, its specimen as new.

    Raises
    ------
    SpecimenError, NoEquilibriumError, UnstableError, StepError, ProofError
        The specimen cannot be used; one sentence each.
    """
    # Messages are needed only for a view's description: other users of this package do not import them.
    from rig_sim.view import Poses, view_geometry

    specimen = break_specimen(load_specimen(path), faults)
    sdf = path.with_name(specimen.sdf)
    try:
        plant = load_plant(sdf)
        tree = read_tree(plant)
    except ValueError as error:
        raise SpecimenError(f"specimen {specimen.name}: {error}") from error
    model = RigModel(assemble(specimen, tree))
    files = (sdf, *document_files(path))
    key = content_hash(files, faults)
    compiled = cached_model(
        key,
        lambda: compile_model(
            model.traced,
            state_names=model.state_names,
            input_names=model.input_names,
            output_names=model.output_names,
            shared=True,
        ),
    )
    # Also for code from the cache: the content of a file may be wrong.
    late_proof = LateProof(lambda: prove(model, compiled, plant))
    if not prove_later or engine.engine is Engine.DRAKE:  # Drake's engine takes the plant over
        late_proof.result()
    still = np.zeros(len(model.input_names))
    try:
        rest = _checked_rest(model, compiled, still, engine)
        if model.assembly.wearing:
            # A specimen that cannot be played at the end of its life is refused now, not after weeks.
            failed = WearState(damage={part.name: sys.float_info.max for part in model.assembly.wearing})
            lost = lost_inputs(model, lost_by(model.assembly.wearing, failed))
            _checked_rest(model, compiled, np.concatenate([still[: len(model.drive_names)], lost]), engine)
    except (ValueError, RuntimeError, ArithmeticError):
        # If the code is wrong, that is the reason to report.
        late_proof.result()
        raise
    static = compiled.outputs(rest, still)[: len(specimen.responses)]
    followed = [element.name for element in model.assembly.elements if isinstance(element, HydraulicActuator)]
    player = DrakeEngine(model, plant, engine) if engine.engine is Engine.DRAKE else compiled
    return Rig(
        specimen=specimen,
        model=model,
        compiled=compiled,
        engine=engine,
        player=player,
        late_proof=late_proof,
        rest=rest,
        static_response=static,
        content_hash=content_hash(
            files,
            faults,
            engine=f"engine {engine.model_dump_json()}\n" + (f"specimen {mounted}\n" if specimen.wear else ""),
        ),
        mounted=mounted,
        poses=Poses(tree, key=key),
        geometry=view_geometry(sdf, model.assembly, key=key),
        watchdogs=specimen.set_up_watchdogs(followed=followed, monitored=model.output_names[len(specimen.responses) :]),
        faults=tuple(faults),
    )


def _checked_rest(model: RigModel, compiled: CompiledModel, still: np.ndarray, engine: EngineChoice) -> np.ndarray:
    """Return the equilibrium of the rig; raises if there is none, it is unstable, or it needs a shorter step."""
    rest = find_equilibrium(model, compiled.derivative, still)
    at_rest = linearise(compiled.derivative, rest, still)
    check_stability(at_rest, model.state_names)
    if engine.engine is Engine.COMPILED:  # Drake controls its own steps
        check_step(at_rest, names=model.state_names, specimen=model.assembly.specimen)
    return rest


class Playback(SimulatedPlayback):
    """A playback of a multibody rig, made by `Rig.playback`; read `uses()` at its end."""

    def __init__(
        self,
        rig: Rig,
        drive: np.ndarray,
        *,
        seed: int,
        condition: Condition,
        at_end: Callable[[Playback], None] = lambda _playback: None,
    ) -> None:
        super().__init__(rig.specimen, drive, seed=seed, faults=rig.faults, block_samples=rig.block_samples)
        self._rig = rig
        self._condition = condition
        self._at_end = at_end
        names = rig.model.output_names
        self._load_rows = [names.index(f"{part.name}.load") for part in rig.model.assembly.wearing]
        self._loads: list[np.ndarray] = []
        #: Number of samples that moved the specimen, including ramps.
        self.samples_moved = 0
        self._state = condition.rest.copy()
        self._actuators = [element for element in rig.model.assembly.elements if isinstance(element, HydraulicActuator)]
        self._meter = UseMeter(self._actuators, drives=rig.model.drive_names, outputs=rig.player.output_names)
        self._bounds = self._state_bounds()
        self._given: Played | None = None
        # If it plays ahead: the usual length of its blocks, and what tells whether a block ends the run.
        self._usual: int | None = None
        self._ends_run: Callable[[Block], object] = lambda _block: None
        # States at the ends of the usual blocks in the last block, by the number of samples done.
        self._instants: dict[int, np.ndarray] = {}

    @property
    def rig(self) -> Rig:
        """Rig that plays."""
        return self._rig

    @property
    def positions(self) -> np.ndarray:
        """Drake's positions (n_q,) after the samples played so far."""
        return self._state[: self._rig.model.position_count]

    def instants(self) -> Sequence[int]:
        """Return the ends of the usual blocks in the last block."""
        return tuple(self._instants) or super().instants()

    def frames(self, instants: Sequence[int]) -> np.ndarray:
        """Return the poses of the bodies at some of the `instants`, (instants, bodies, 12)."""
        states = [self._instants.get(instant, self._state) for instant in instants]
        return self._rig.poses.frames(np.array(states)[:, : self._rig.model.position_count])

    def play_ahead(self, samples: int, ends_run: Callable[[Block], object]) -> None:
        """Play blocks of up to `samples`; one that ends the run is taken back and played in usual blocks.

        Sensors with faults remember their past, and Drake's engine is slower than real time: then nothing changes.
        """
        if not self._rig.faults and self._rig.engine.engine is Engine.COMPILED and samples > self.block_samples:
            self._usual, self.block_samples, self._ends_run = self.block_samples, samples, ends_run

    def ramp_down(self) -> Iterator[Block]:
        """Bring all drives to zero, in usual blocks: the end of a run is not taken back."""
        self._play_usual_blocks()
        return super().ramp_down()

    def _play_usual_blocks(self) -> None:
        if self._usual is not None:
            self.block_samples, self._usual = self._usual, None

    def _go_on(self, commands: np.ndarray, *, counted: bool) -> Block:
        usual = self._usual
        if usual is None or commands.shape[1] - 1 <= usual:
            return super()._go_on(commands, counted=counted)
        before = self._next, self._heading, self._state, self.samples_moved, len(self._loads)
        noise = self._noise.bit_generator.state
        with suppress(RigFaultError):
            block = super()._go_on(commands, counted=counted)
            if not self._ends_run(block):
                return block
            if counted:
                self._meter.take_back()
        self._next, self._heading, self._state, self.samples_moved, loads = before
        del self._loads[loads:]
        self._noise.bit_generator.state = noise
        self._play_usual_blocks()
        return super()._go_on(commands[:, : usual + 1], counted=counted)

    def uses(self) -> list[Use]:
        """Return the use of every drive channel by the drive so far, without ramps."""
        return self._meter.uses(self.peak_ratios(), samples=self.samples_done)

    def end(self) -> None:
        """Call `at_end` at the end of the run."""
        self._at_end(self)

    def loads(self) -> np.ndarray:
        """Return the loads of the wearing parts (parts, samples) so far, including ramps."""
        return np.hstack([np.empty((len(self._load_rows), 0)), *self._loads])

    def next_run(self) -> Run | None:
        """Return the next request to the engine, for a batch of playbacks; None at the end."""
        commands = self._ahead()
        return self._run(commands) if commands.shape[1] > 1 else None

    def give(self, played: Played) -> None:
        """Set the engine's answer to `next_run`."""
        self._given = played

    def _run(self, commands: np.ndarray) -> Run:
        lost = self._condition.lost
        if lost.size:
            commands = np.vstack([commands, np.broadcast_to(lost[:, None], (len(lost), commands.shape[1]))])
        return Run(self._state, commands, self._bounds)

    def _play(self, commands: np.ndarray) -> Played:
        given, self._given = self._given, None
        if given is not None:
            return given
        run, player = self._run(commands), self._rig.player
        if self._usual is None or not isinstance(player, CompiledModel):
            return player.play(run.state, run.commands, bounds=self._bounds, **self._rig.steps)
        return player.play(run.state, run.commands, bounds=self._bounds, state_every=self._usual, **self._rig.steps)

    def _advance(self, commands: np.ndarray, first: int, *, counted: bool) -> Block:
        rig = self._rig
        played = self._play(commands)
        self.samples_moved += played.outputs.shape[1]
        if self._load_rows:
            self._loads.append(played.outputs[self._load_rows])
        if played.diverged_at is not None:
            raise RigFaultError(self._explain(played.diverged_states, first + played.diverged_at))
        self._state = played.state
        usual, end = self._usual or self.block_samples, first + played.outputs.shape[1]
        self._instants = {
            min(first + usual * (place + 1), end): state for place, state in enumerate(played.states_on_the_way)
        }
        following_error = self._meter.following_error(commands[:, :-1], played.outputs)
        if counted:
            self._meter.count(following_error, played.outputs)
        responses = len(rig.specimen.responses)
        return Block(
            first_sample=first,
            drive=commands[:, :-1],
            response=self._sensed(first, self._condition.gains * played.outputs[:responses]),
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
            return f"{pistons} {when(seconds)}; lower the drive."
        return (
            f"the motion of {self._rig.specimen.name} became unbounded {when(seconds)}, among others in "
            f"{states[0]!r}; lower the drive or take more substeps."
        )
