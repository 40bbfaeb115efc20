"""Machine code for several rigs of one structure, one in each lane of a vector: the player of batches.

Arrays are [place][lane]. The result of a lane depends on its own numbers only: this package, not a compiler, decides
which products and sums are fused, so a playback has the same bytes in every lane, beside any others, and in vectors
of any width.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Final

import numpy as np
from llvmlite import binding as llvm

from rig_sim.compile.code_cache import cached_module
from rig_sim.compile.compiled_model import CompiledModule, NamedModel, Playback, Run
from rig_sim.compile.expansion import expanded
from rig_sim.compile.integrate import COMPLETED, LANES_PLAY_SIGNATURE, Method, play_symbol, play_text
from rig_sim.compile.llvm_text import declarations, function_text, vector_kind
from rig_sim.compile.tracing import Expression, TracedModel
from rig_sim.compile.variants import Variants, fused

WIDTHS: Final = (4, 8)
"""Numbers of rigs in a vector: AVX2 has four doubles, AVX-512 eight."""

_ALIGNMENT: Final = 64
_OBSERVE_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)


@cache
def widest_lanes() -> int:
    """Return the number of doubles in a vector of this processor; 1 if rigs are played one by one."""
    features = llvm.get_host_cpu_features()
    if features.get("avx512f") and features.get("avx512dq"):
        return 8
    # Without fused operations each lane would call the mathematical library.
    return 4 if features.get("avx2") and features.get("fma") else 1


def lane_width(rigs: int) -> int:
    """Return the vector width for a number of rigs: the narrowest that holds all of them, else the widest."""
    return next((width for width in WIDTHS if rigs <= width <= widest_lanes()), widest_lanes())


def lanes_text(traced: TracedModel, constants: Sequence[Expression], *, width: int) -> str:
    """Write the module of united variants; `constants` are the leaves read from the table."""
    kind = vector_kind(width)
    traced = fused(expanded(traced))
    graph = traced.state[0].graph
    table = [graph.input(constant.name) for constant in constants]
    arguments, rates = (traced.state, traced.inputs, table), traced.derivative
    reduced = f"declare i1 @llvm.vector.reduce.and.v{width}i1({kind.truth})"
    return "\n".join(
        [
            declarations(kind),
            reduced,
            function_text("derivative", arguments, (rates,), contract=False, kind=kind),
            function_text("observe", arguments, (rates, traced.outputs), contract=False, kind=kind),
            play_text(states=len(traced.state), inputs=len(traced.inputs), outputs=len(traced.outputs), kind=kind),
        ]
    )


@lru_cache(maxsize=8)
def _module(text: str) -> CompiledModule:
    return cached_module(text)


class LaneModel(NamedModel):
    """Machine code of united variants, `width` of them at a time."""

    def __init__(
        self,
        variants: Variants,
        *,
        width: int,
        state_names: tuple[str, ...],
        input_names: tuple[str, ...],
        output_names: tuple[str, ...],
    ) -> None:
        super().__init__(state_names=state_names, input_names=input_names, output_names=output_names)
        self.width = width
        self._values = variants.values
        self._module = _module(lanes_text(variants.traced, variants.constants, width=width))
        self._observe = _OBSERVE_SIGNATURE(self._module.address("observe"))
        self._play = {method: LANES_PLAY_SIGNATURE(self._module.address(play_symbol(method))) for method in Method}

    def evaluate(self, variants: Sequence[int], runs: Sequence[Run]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return derivative and outputs of each run at its state and its first command."""
        lanes = _Lanes(self._values, variants, width=self.width)
        state = lanes.spread([self._vector(run.state, self.state_names, "state") for run in runs])
        inputs = lanes.spread([self._commands(run.commands)[:, 0] for run in runs])
        derivative, outputs = (_aligned((len(names), self.width)) for names in (self.state_names, self.output_names))
        self._observe(*(array.ctypes.data for array in (state, inputs, lanes.table, derivative, outputs)))
        return [(derivative[:, lane].copy(), outputs[:, lane].copy()) for lane in range(len(runs))]

    def play(
        self, variants: Sequence[int], runs: Sequence[Run], *, sample_interval: float, substeps: int, method: Method
    ) -> list[Playback]:
        """Integrate a run of each variant as :meth:`CompiledModel.play`; runs do not affect each other.

        Raises `ValueError` as that method, and if there are more runs than lanes.
        """
        if not 1 <= len(runs) <= self.width:
            raise ValueError(f"There are {len(runs)} runs for {self.width} lanes; give 1 to {self.width}.")
        self._check_steps(sample_interval, substeps)
        commands = [self._commands(run.commands) for run in runs]
        limits = [self._limits(run.bounds) for run in runs]
        states = [self._vector(run.state, self.state_names, "state") for run in runs]
        ends = [command.shape[1] - 1 for command in commands]
        outputs = [np.empty((len(self.output_names), end)) for end in ends]
        playbacks: dict[int, Playback] = {}
        begin = 0
        while live := [run for run in range(len(runs)) if run not in playbacks]:
            # Up to the first end of a run: chunks give the same bits as one call.
            until = min(ends[run] for run in live)
            lanes = _Lanes(self._values, [variants[run] for run in live], width=self.width)
            state = lanes.spread([states[run] for run in live])
            bounds = lanes.spread([limits[run] for run in live])
            command = lanes.spread([commands[run][:, begin : until + 1] for run in live])
            output = _aligned((len(self.output_names), until - begin, self.width))
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
                outputs[run][:, begin : begin + played] = output[:, :played, lane]
                states[run] = state[:, lane].copy()
            begin += played
            for run in live:
                outside = self._states_outside(states[run], limits[run])
                if outside:
                    kept = np.ascontiguousarray(outputs[run][:, :begin])
                    playbacks[run] = Playback(kept, states[run], begin, outside)
                elif begin == ends[run]:
                    playbacks[run] = Playback(outputs[run], states[run], None, ())
        return [playbacks[run] for run in range(len(runs))]


class _Lanes:
    """Parallel runs; lanes without a run repeat the first one, so that they add no other motion."""

    def __init__(self, values: np.ndarray, variants: Sequence[int], *, width: int) -> None:
        self._of_lane = [*range(len(variants)), *[0] * (width - len(variants))]
        self.table = _aligned((len(values), width))
        self.table[:] = values[:, [variants[place] for place in self._of_lane]]

    def spread(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Return one array of each run with the lanes as its last axis."""
        spread = _aligned((*arrays[0].shape, len(self._of_lane)))
        for lane, place in enumerate(self._of_lane):
            spread[..., lane] = arrays[place]
        return spread


def _aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Return an uninitialised array that begins at a cache line."""
    size = 8 * int(np.prod(shape))
    memory = np.empty(size + _ALIGNMENT, dtype=np.uint8)
    offset = -memory.ctypes.data % _ALIGNMENT
    return memory[offset : offset + size].view(np.float64).reshape(shape)
