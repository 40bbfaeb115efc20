"""Proof at load: the compiled player must agree with Drake at random states, or the rig does not start.

Drake verifies the mechanics: it gets the same positions and velocities, and the forces of the YAML's elements as
external forces; it computes tree, gravity and the linear elements of the SDF itself. The rates of the elements' own
states (hydraulics, rubber, tyres), which are not in Drake, are compared with plain numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any, cast

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from rig_sim.compile import CompiledModel, LaneModel, Run, at_once, taken
from rig_sim.engines import AppliedForces, applied_force, drake_responses
from rig_sim.model import Evaluation, RigModel
from rig_sim.multibody import cross

LARGEST_ERROR = 1.0e-9
STATES = 24
#: Number of states of each rig in a batch, whose single player was proven at all `STATES`.
STATES_IN_LANES = 3


class ProofError(RuntimeError):
    """Disagreement of the player and Drake, in one sentence."""


@dataclass(frozen=True)
class Proof:
    """Largest differences over all random states, relative to the largest value of each kind at its state."""

    position_rate_error: float
    acceleration_error: float
    force_error: float
    element_rate_error: float
    states: int


class LateProof:
    """Proof that is made at its first use, on whichever thread that is; a failed one is raised at every use.

    `prove`: Makes it.
    """

    def __init__(self, prove: Callable[[], Proof]) -> None:
        self._prove = prove
        self._lock = Lock()
        self._made: Proof | ProofError | None = None

    def result(self) -> Proof:
        """Return the proof; raises `ProofError` if the player must not play."""
        with self._lock:
            if self._made is None:
                try:
                    self._made = self._prove()
                except ProofError as error:
                    self._made = error
                except (ValueError, RuntimeError, ArithmeticError, LookupError) as error:
                    self._made = ProofError(f"the proof against Drake failed ({error}), so this rig must not play.")
        if isinstance(self._made, ProofError):
            raise self._made
        return self._made


@dataclass(frozen=True)
class DrakeAnswers:
    """Drake's values at one state: position rates (n_q,), accelerations (n_v,), responses (responses,)."""

    position_rates: np.ndarray
    accelerations: np.ndarray
    responses: np.ndarray


def prove(model: RigModel, compiled: CompiledModel, plant: MultibodyPlant, *, seed: int = 0) -> Proof:
    """Compare the compiled player with Drake at random states around the design position.

    Raises `ProofError` if a difference is above 1e-9; names the degree of freedom or channel and both values.
    """
    rng = np.random.default_rng(seed)
    n_q, n_v = model.position_count, model.assembly.tree.velocity_count
    names = model.state_names
    worst = np.zeros(4)
    drawn = [(random_state(model, rng), _random_inputs(model, rng)) for _ in range(STATES)]
    # Once for all of them: the model in Python takes a hundred times as long as its computation.
    evaluation = model.evaluate(*(at_once(np.array(rows)) for rows in zip(*drawn, strict=True)))
    for instant, (state, inputs) in enumerate(drawn):
        drake = drake_answers(model, plant, state, inputs, evaluation, instant=instant)
        rates = compiled.derivative(state, inputs)
        responses = compiled.outputs(state, inputs)[: len(model.response_names)]
        elements = taken(evaluation.derivative[n_q + n_v :], instant)
        errors = (
            _compare(rates[:n_q], drake.position_rates, names[:n_q]),
            _compare(rates[n_q : n_q + n_v], drake.accelerations, names[n_q : n_q + n_v]),
            _compare_responses(model, responses, drake.responses),
            _compare(rates[n_q + n_v :], elements, names[n_q + n_v :], judge="plain numpy"),
        )
        worst = np.maximum(worst, errors)
    return Proof(*(float(error) for error in worst), states=STATES)


def check_lanes(lanes: LaneModel, rigs: Sequence[tuple[RigModel, CompiledModel]], *, seed: int = 0) -> float:
    """Compare rigs in lanes with their single players, which are proven, at random states; return the largest error.

    Raises `ProofError` as `prove`.
    """
    rng = np.random.default_rng(seed)
    worst = 0.0
    for first in range(0, len(rigs), lanes.rigs):
        variants = range(first, min(first + lanes.rigs, len(rigs)))
        for _ in range(STATES_IN_LANES):
            points = [(random_state(rigs[at][0], rng), _random_inputs(rigs[at][0], rng)) for at in variants]
            answers = lanes.evaluate(variants, [Run(state, inputs[:, None]) for state, inputs in points])
            for at, (state, inputs), (rates, outputs) in zip(variants, points, answers, strict=True):
                model, single = rigs[at]
                judge = "that of the single rig"
                count = len(model.response_names)
                right = single.outputs(state, inputs)
                monitored = model.output_names[count:]
                worst = max(
                    worst,
                    _compare(rates, single.derivative(state, inputs), model.state_names, judge=judge),
                    _compare_responses(model, outputs[:count], right[:count], judge=judge),
                    _compare(outputs[count:], right[count:], monitored, judge=judge),
                )
    return worst


def _compare(own: np.ndarray, right: np.ndarray, names: tuple[str, ...], *, judge: str = "Drake") -> float:
    if not names:
        return 0.0
    error = np.abs(own - right) / np.max(np.abs(right))
    worst = int(np.argmax(error))
    if not error[worst] <= LARGEST_ERROR:
        raise ProofError(
            f"the player disagrees with {judge} at {names[worst]!r}: {own[worst]:.12g} against {right[worst]:.12g}; "
            f"{LARGEST_ERROR:g} of the largest value is allowed, so this rig must not play."
        )
    return float(error[worst])


def _compare_responses(model: RigModel, own: np.ndarray, right: np.ndarray, *, judge: str = "Drake") -> float:
    """Compare the responses unit by unit, because newtons and metres are not comparable."""
    channels = model.assembly.specimen.responses
    worst = 0.0
    for unit in {channel.unit: None for channel in channels}:
        rows = [row for row, channel in enumerate(channels) if channel.unit == unit]
        worst = max(worst, _compare(own[rows], right[rows], tuple(channels[row].name for row in rows), judge=judge))
    return worst


def random_state(model: RigModel, rng: np.random.Generator) -> np.ndarray:
    """Return a state near the design position: centimetres, degrees, metres per second, bars."""
    n_q, n_v = model.position_count, model.assembly.tree.velocity_count
    state = model.design_state.copy()
    state[:n_q] += 0.02 * rng.standard_normal(n_q)
    state[n_q : n_q + n_v] = 0.5 * rng.standard_normal(n_v)
    state[n_q + n_v :] += 0.3 * rng.standard_normal(len(state) - n_q - n_v)
    model.normalise_quaternions(state)
    return state


def _random_inputs(model: RigModel, rng: np.random.Generator) -> np.ndarray:
    drives = [0.05 * channel.maximum * rng.standard_normal() for channel in model.assembly.specimen.drives]
    return np.array([*drives, *rng.uniform(0.0, 1.0, len(model.input_names) - len(drives))])


def drake_answers(
    model: RigModel,
    plant: MultibodyPlant,
    state: np.ndarray,
    inputs: np.ndarray,
    evaluation: Evaluation,
    *,
    instant: int = 0,
) -> DrakeAnswers:
    """Evaluate Drake at a state, with the forces of the YAML's elements from `evaluation`.

    `instant`: Index of this state in an evaluation of many states.
    """
    # pydrake's stubs use dtype parameters as shapes, so its arrays do not match numpy's types.
    drake = cast(Any, plant)
    context = plant.CreateDefaultContext()
    n_q, n_v = model.position_count, model.assembly.tree.velocity_count
    drake.SetPositions(context, state[:n_q])
    drake.SetVelocities(context, state[n_q : n_q + n_v])
    _apply_own_effect(plant, context, evaluation, instant)
    accelerations = plant.EvalTimeDerivatives(context).get_generalized_velocity().CopyToVector()
    return DrakeAnswers(
        position_rates=np.array(drake.MapVelocityToQDot(context, state[n_q : n_q + n_v]), dtype=float),
        accelerations=np.array(accelerations, dtype=float),
        responses=drake_responses(model, plant, context, state, inputs),
    )


def _apply_own_effect(plant: MultibodyPlant, context: Context, evaluation: Evaluation, instant: int) -> None:
    """Set Drake's force inputs to the forces of the YAML's elements."""
    forces = []
    for index, wrench in enumerate(evaluation.own_effect.wrenches[1:], start=1):
        origin = taken(evaluation.motion.poses[index].origin, instant)
        force = taken(wrench.linear, instant)
        # Written out: numpy's takes most of the time of these loops.
        moment = taken(wrench.angular, instant) - cross(origin, force)
        forces.append(applied_force(index, np.concatenate([moment, force])))
    plant.get_applied_spatial_force_input_port().FixValue(context, AppliedForces(forces))
    joint_forces = taken(evaluation.own_effect.joint_forces, instant)
    plant.get_applied_generalized_force_input_port().FixValue(context, joint_forces)
