"""Machine code for several rigs of one structure in the lanes of a vector: the player of batches.

A rig is one lane, or two if its sides mirror each other. Arrays are [place][rig], outputs [place][rig][sample]. The
result of a lane depends on its own numbers only: this package, not a compiler, decides which products and sums are
fused, so a playback has the same bytes in every lane, beside any others, and in vectors of any width.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

import numpy as np
from llvmlite import binding as llvm

from rig_sim.compile.code_cache import cached_module
from rig_sim.compile.compiled_model import DERIVATIVE_SIGNATURE, CompiledModule, NamedModel, Playback, Run, aligned
from rig_sim.compile.constants import LaneTable
from rig_sim.compile.expansion import expanded
from rig_sim.compile.integrate import COMPLETED, PLAY_SIGNATURE, Method, padded, play_symbol, play_text
from rig_sim.compile.lanes import MirroredModel, mirrored_model
from rig_sim.compile.llvm_text import declarations, model_text, vector_kind
from rig_sim.compile.tracing import Expression, TracedModel
from rig_sim.compile.variants import Variants, fused

WIDTHS: Final = (4, 8)
"""Doubles in a vector: AVX2 has four, AVX-512 eight."""


@cache
def widest_lanes() -> int:
    """Return the number of doubles in a vector of this processor; 1 if rigs are played one by one."""
    features = llvm.get_host_cpu_features()
    if features.get("avx512f") and features.get("avx512dq"):
        return 8
    # Without fused operations each lane would call the mathematical library.
    return 4 if features.get("avx2") and features.get("fma") else 1


#: Processors, as LLVM calls them, on which roots and divisions of vectors were measured to be faster than products.
_FAST_DIVIDERS: Final = frozenset({"znver5"})


@dataclass(frozen=True)
class PlannedVariants:
    """United variants, ready to be written; `mirrored` has both sides of a rig in one vector, if it has two."""

    traced: TracedModel
    constants: tuple[Expression, ...]
    mirrored: MirroredModel | None

    @classmethod
    def of(cls, variants: Variants) -> PlannedVariants:
        """Plan how the variants are computed; it depends on no value."""
        traced = expanded(variants.traced, roots_by_products=llvm.get_host_cpu_name() not in _FAST_DIVIDERS)
        constants = _leaves(traced, variants)
        mirrored = mirrored_model(traced, constants)
        if mirrored is None:
            traced = fused(traced)
            constants = _leaves(traced, variants)
        return cls(traced, constants, mirrored)

    @property
    def sides(self) -> int:
        """Number of lanes of a rig in a vector."""
        return 1 if self.mirrored is None else 2

    def text(self, table: LaneTable, *, width: int) -> str:
        """Write the module with vectors of `width` doubles."""
        traced, rigs = self.traced, width // self.sides
        kinds = vector_kind(rigs), vector_kind(width)
        if self.mirrored is not None:
            functions = self.mirrored.text(contract=True, table=table, rigs=rigs)
        else:
            functions = model_text(traced, contract=False, kind=kinds[0], table=table)
        sizes = {"states": len(traced.state), "inputs": len(traced.inputs), "outputs": len(traced.outputs)}
        return "\n".join([declarations(*kinds), functions, play_text(**sizes, rigs=rigs, width=width)])


def _leaves(traced: TracedModel, variants: Variants) -> tuple[Expression, ...]:
    graph = traced.state[0].graph
    return tuple(graph.input(constant.name) for constant in variants.constants)


@lru_cache(maxsize=8)
def _module(text: str) -> CompiledModule:
    return cached_module(text)


class LaneModel(NamedModel):
    """Machine code of united variants.

    `width`: Doubles in a vector. `rigs`: Number of runs at a time; half the width if both sides of a rig are in lanes.
    """

    def __init__(
        self,
        variants: Variants,
        *,
        runs: int,
        widest: int | None = None,
        state_names: tuple[str, ...],
        input_names: tuple[str, ...],
        output_names: tuple[str, ...],
    ) -> None:
        """Compile for a number of runs: vectors are the narrowest that hold all of them, else the widest, in doubles.

        `widest` is that of this processor by default. Raises `ValueError` if names and arrays of the variants do not
        match: the code would write beyond its arrays.
        """
        traced = variants.traced
        sizes = tuple(len(group) for group in (traced.state, traced.inputs, traced.outputs))
        if sizes != (names := (len(state_names), len(input_names), len(output_names))):
            raise ValueError(
                f"The variants have {sizes} states, inputs and outputs for {names} names; name each of them."
            )
        super().__init__(state_names=state_names, input_names=input_names, output_names=output_names)
        planned = PlannedVariants.of(variants)
        widest = widest_lanes() if widest is None else widest
        self.width = next((width for width in WIDTHS if runs * planned.sides <= width <= widest), widest)
        self.rigs = self.width // planned.sides
        table = LaneTable(planned.constants, rigs=self.rigs)
        self._module = _module(planned.text(table, width=self.width))
        self._constants = table.content(variants.values)
        self._last: tuple[tuple[int, ...], _Lanes] | None = None
        order = range(len(state_names)) if planned.mirrored is None else planned.mirrored.order
        self._order = np.array(order)
        self._places = np.argsort(self._order)
        self._derivative = DERIVATIVE_SIGNATURE(self._module.address("derivative"))
        self._play = {method: PLAY_SIGNATURE(self._module.address(play_symbol(method))) for method in Method}

    def _lanes(self, variants: Sequence[int]) -> _Lanes:
        """Return the lanes of some variants; the blocks of a playback use the same ones."""
        # Read and written once: another thread may play a batch, too.
        last, key = self._last, tuple(variants)
        if last is None or last[0] != key:
            last = self._last = key, _Lanes(self._constants, variants, rigs=self.rigs)
        return last[1]

    def evaluate(self, variants: Sequence[int], runs: Sequence[Run]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return derivative and outputs of each run at its state and its first command."""
        lanes = self._lanes(variants)
        state = lanes.spread([self._vector(run.state, self.state_names, "state")[self._order] for run in runs])
        inputs = lanes.spread([self._commands(run.commands)[:, 0] for run in runs])
        derivative, outputs = (aligned((len(names), self.rigs)) for names in (self.state_names, self.output_names))
        self._derivative(*(array.ctypes.data for array in (state, inputs, lanes.table, derivative, outputs)))
        derivative = derivative[self._places]
        return [(derivative[:, lane].copy(), outputs[:, lane].copy()) for lane in range(len(runs))]

    def play(
        self, variants: Sequence[int], runs: Sequence[Run], *, sample_interval: float, substeps: int, method: Method
    ) -> list[Playback]:
        """Integrate a run of each variant as :meth:`CompiledModel.play`; runs do not affect each other.

        Raises `ValueError` as that method, and if there are more runs than fit.
        """
        if not 1 <= len(runs) <= self.rigs:
            raise ValueError(f"There are {len(runs)} runs for {self.rigs} lanes; give 1 to {self.rigs}.")
        self._check_steps(sample_interval, substeps)
        commands = [self._commands(run.commands) for run in runs]
        limits = [self._limits(run.bounds) for run in runs]
        states = [self._vector(run.state, self.state_names, "state") for run in runs]
        ends = [command.shape[1] - 1 for command in commands]
        outputs: list[list[np.ndarray]] = [[] for _ in runs]
        count = len(self.state_names)
        room = padded(count, rigs=self.rigs, width=self.width)
        playbacks: dict[int, Playback] = {}
        begin = 0
        while live := [run for run in range(len(runs)) if run not in playbacks]:
            # Up to the first end of a run: chunks give the same bits as one call.
            until = min(ends[run] for run in live)
            lanes = self._lanes([variants[run] for run in live])
            state = lanes.spread([states[run][self._order] for run in live], room=room)
            bounds = lanes.spread([limits[run][self._order] for run in live], room=room)
            command = lanes.spread([commands[run][:, begin : until + 1] for run in live])
            output = aligned((len(self.output_names), self.rigs, until - begin))
            status = self._play[method](
                state.ctypes.data,
                command.ctypes.data,
                command.shape[1],
                output.ctypes.data,
                until - begin,
                until - begin,
                int(substeps),
                sample_interval / substeps,
                bounds.ctypes.data,
                lanes.table.ctypes.data,
            )
            played = until - begin if status == COMPLETED else int(status)
            for lane, run in enumerate(live):
                outputs[run].append(output[:, lane, :played])
                states[run] = state[:count, lane][self._places]
            begin += played
            for run in live:
                outside = () if status == COMPLETED else self._states_outside(states[run], limits[run])
                if outside or begin == ends[run]:
                    # One part, which is not copied, unless other runs ended before.
                    whole = outputs[run][0] if len(outputs[run]) == 1 else np.hstack(outputs[run])
                    playbacks[run] = Playback(whole, states[run], begin if outside else None, outside)
        return [playbacks[run] for run in range(len(runs))]


class _Lanes:
    """Parallel runs; lanes without a run repeat the first one, so that they add no other motion."""

    def __init__(self, constants: np.ndarray, variants: Sequence[int], *, rigs: int) -> None:
        self._of_lane = [*range(len(variants)), *[0] * (rigs - len(variants))]
        self.table = aligned((len(constants), rigs))
        self.table[:] = constants[:, [variants[place] for place in self._of_lane]]

    def spread(self, arrays: Sequence[np.ndarray], *, room: int | None = None) -> np.ndarray:
        """Return one array of each run with the lanes as its last axis; with `room` for more places, which are 0."""
        length, *rest = arrays[0].shape
        spread = aligned((length if room is None else room, *rest, len(self._of_lane)))
        spread[length:] = 0.0
        for lane, place in enumerate(self._of_lane):
            spread[:length, ..., lane] = arrays[place]
        return spread
