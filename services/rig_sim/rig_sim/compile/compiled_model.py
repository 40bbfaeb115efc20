"""A model as machine code: evaluate it, play it."""

import ctypes
import ctypes.util
import math
import sys
import weakref
from dataclasses import dataclass
from functools import cache
from typing import TypedDict

import numpy as np
from llvmlite import binding as llvm
from numpy.typing import ArrayLike

from rig_sim.compile.integrate import COMPLETED, PLAY_SIGNATURE, Method, padded, play_symbol
from rig_sim.compile.short_addresses import IS_POSSIBLE, shortened

#: Functions called on processors without the instruction.
_LIBM = ("fma", "floor")


@dataclass(frozen=True)
class CompiledModule:
    """Machine code in memory; its addresses are valid only during the lifetime of this object."""

    engine: llvm.ExecutionEngine
    code: bytes
    """Object file of the machine code."""

    def address(self, symbol: str) -> int:
        """Return the address of a function."""
        address = self.engine.get_function_address(symbol)
        if not address:
            raise ValueError(f"The compiled module has no function {symbol!r}; name one that its text defines.")
        return address


def compile_module(text: str, *, optimization: int = 2) -> CompiledModule:
    """Compile a module."""
    _initialize()
    context = llvm.create_context()
    module = llvm.parse_assembly(text, context)
    module.verify()
    target = _target(optimization)
    tuning = llvm.create_pipeline_tuning_options(speed_level=optimization)
    # Packing neighbouring scalars gains only 1 to 3 % on traced models: lanes use the vectors.
    tuning.slp_vectorization = False
    builder = llvm.create_pass_builder(target, tuning)
    builder.getModulePassManager().run(module, builder)
    if IS_POSSIBLE:
        module = llvm.parse_assembly(_as_module(shortened(target.emit_assembly(module), "derivative")), context)
    return link_module(target.emit_object(module), context)


def _as_module(assembly: str) -> str:
    """Return a module of an assembly."""
    lines = (line.replace("\\", "\\5C").replace('"', "\\22") for line in assembly.split("\n"))
    return "\n".join(f'module asm "{line}"' for line in lines)


def link_module(code: bytes, context: llvm.ContextRef | None = None) -> CompiledModule:
    """Return a module compiled before; the caller must check that it was for this processor, or it crashes."""
    _initialize()
    context = context or llvm.create_context()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly("", context), _target(0))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    compiled = CompiledModule(engine, code)
    # The garbage collector finalises a cycle in any order; the engine must be closed before the context of its
    # module, or LLVM reads freed memory. Held here, both live as long as their module.
    weakref.finalize(compiled, _dispose, engine, context).atexit = False
    return compiled


def _target(optimization: int) -> llvm.TargetMachine:
    return llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=optimization, jit=True
    )


def _dispose(engine: llvm.ExecutionEngine, context: llvm.ContextRef) -> None:
    engine.close()
    context.close()


@cache
def _initialize() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.initialize_native_asmparser()
    # LLVM looks up symbols in the process, where a statically linked Python has no libm: register the addresses.
    library = ctypes.CDLL("libm.so.6" if sys.platform == "linux" else ctypes.util.find_library("m"))
    for name in _LIBM:
        llvm.add_symbol(name, ctypes.cast(getattr(library, name), ctypes.c_void_p).value)


_ALIGNMENT = 64


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Return an uninitialised array that begins at a cache line."""
    size = 8 * math.prod(shape)
    memory = np.empty(size + _ALIGNMENT, dtype=np.uint8)
    offset = -memory.ctypes.data % _ALIGNMENT
    return memory[offset : offset + size].view(np.float64).reshape(shape)


DERIVATIVE_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)


@dataclass(frozen=True)
class Playback:
    """Result of playing a model.

    Attributes
    ----------
    outputs : ndarray, (outputs, samples)
        Outputs at the sample instants, up to the sample before the model diverged.
    state : ndarray, (states,)
        State at the instant after the last sample, or where the model diverged: start of the next chunk.
    diverged_at : int or None
        Sample with a state that is not finite or out of bounds, 0 to samples; None if there is no such sample.
    diverged_states : tuple of str
        Names of these states.
    states_on_the_way : tuple of ndarray, (states,)
        States at regular intervals, if they were requested; the last one is `state`.
    """

    outputs: np.ndarray
    state: np.ndarray
    diverged_at: int | None
    diverged_states: tuple[str, ...]
    states_on_the_way: tuple[np.ndarray, ...] = ()


class Steps(TypedDict):
    """Steps of an integration: sample interval in s, steps per sample, and method."""

    sample_interval: float
    substeps: int
    method: Method


@dataclass(frozen=True)
class Run:
    """Run to play: initial state, commands (inputs, samples + 1) and bounds of the states."""

    state: np.ndarray
    commands: np.ndarray
    bounds: np.ndarray | None = None


@dataclass(frozen=True)
class _Bounds:
    """Checked bounds of the states, once for all blocks of a playback; `inner` is what the code at `address` reads."""

    content: bytes
    magnitudes: np.ndarray
    inner: np.ndarray
    address: int


class NamedModel:
    """Names of a model's states, inputs and outputs, and checks of its arguments."""

    def __init__(
        self, *, state_names: tuple[str, ...], input_names: tuple[str, ...], output_names: tuple[str, ...]
    ) -> None:
        self.state_names = state_names
        self.input_names = input_names
        self.output_names = output_names

    def _commands(self, commands: ArrayLike) -> np.ndarray:
        command = np.ascontiguousarray(commands, dtype=np.float64)
        if command.ndim != 2 or command.shape[0] != len(self.input_names) or command.shape[1] < 1:
            raise ValueError(
                f"The commands have the shape {command.shape}; give ({len(self.input_names)}, samples + 1), one row "
                "per input."
            )
        if not np.isfinite(command).all():
            input_index, sample = np.argwhere(~np.isfinite(command))[0]
            raise ValueError(
                f"The command {self.input_names[input_index]!r} is {command[input_index, sample]} at sample {sample}; "
                "give finite numbers."
            )
        return command

    @staticmethod
    def _check_steps(sample_interval: float, substeps: int) -> None:
        if not (np.isfinite(sample_interval) and sample_interval > 0.0):
            raise ValueError(f"The sample interval is {sample_interval} s; give a finite one above 0.")
        if substeps < 1 or substeps != int(substeps):
            raise ValueError(f"The number of substeps is {substeps}; give a whole number of at least 1.")

    def _states_outside(self, state: np.ndarray, limits: np.ndarray) -> tuple[str, ...]:
        outside = ~(np.abs(state) <= limits)
        return tuple(name for name, out in zip(self.state_names, outside, strict=True) if out)

    def _limits(self, bounds: ArrayLike | None) -> np.ndarray:
        largest = np.finfo(np.float64).max  # any finite state
        if bounds is None:
            return np.full(len(self.state_names), largest)
        limits = self._vector(bounds, self.state_names, "bounds")
        if not (limits > 0.0).all():
            index = int(np.argmin(limits > 0.0))
            raise ValueError(
                f"The bound of the state {self.state_names[index]!r} is {limits[index]}; give a magnitude above 0."
            )
        return np.minimum(limits, largest)

    @staticmethod
    def _vector(values: ArrayLike, names: tuple[str, ...], what: str) -> np.ndarray:
        vector = np.ascontiguousarray(values, dtype=np.float64)
        if vector.shape != (len(names),):
            raise ValueError(f"The {what} has the shape {vector.shape}; give ({len(names)},).")
        return vector


class CompiledModel(NamedModel):
    """A model as machine code. Made by :func:`compile_model`; may be called from several threads at once.

    `constants`: Table that the code reads. `operation_count`: Operations of one evaluation of the derivative, both
    sides of a mirrored model counted. `lanes`: 2 if both sides of the model are computed as lanes of vectors, else 1.
    """

    def __init__(
        self,
        module: CompiledModule,
        constants: np.ndarray,
        *,
        state_names: tuple[str, ...],
        input_names: tuple[str, ...],
        output_names: tuple[str, ...],
        operation_count: int,
        state_order: tuple[int, ...] | None = None,
    ) -> None:
        super().__init__(state_names=state_names, input_names=input_names, output_names=output_names)
        self._module = module  # keeps the code alive
        self.constants = aligned((len(constants),))
        self.constants[:] = constants
        self._constants_address = self.constants.ctypes.data
        self._bounds: _Bounds | None = None
        self._derivative = DERIVATIVE_SIGNATURE(module.address("derivative"))
        self._play = {method: PLAY_SIGNATURE(module.address(play_symbol(method))) for method in Method}
        self.operation_count = operation_count
        self.state_order = state_order
        self.lanes = 1 if state_order is None else 2
        # If the code has another order of the states: the state at each place, and the place of each state.
        self._order = np.arange(len(state_names)) if state_order is None else np.array(state_order)
        self._places = np.argsort(self._order)

    @property
    def code(self) -> bytes:
        """Object file of the machine code."""
        return self._module.code

    def derivative(self, state: ArrayLike, inputs: ArrayLike) -> np.ndarray:
        """Evaluate the time derivative of the state."""
        values = self._vector(state, self.state_names, "state")[self._order]
        given = self._vector(inputs, self.input_names, "inputs")
        derivative = np.empty(len(self.state_names))
        self._derivative(*(array.ctypes.data for array in (values, given, self.constants, derivative)), None)
        return derivative[self._places]

    def outputs(self, state: ArrayLike, inputs: ArrayLike) -> np.ndarray:
        """Evaluate the outputs."""
        return self.outputs_at(self._vector(state, self.state_names, "state")[None], inputs)[0]

    def outputs_at(self, states: np.ndarray, inputs: ArrayLike) -> np.ndarray:
        """Evaluate the outputs (instants, outputs) at several states (instants, states) with the same inputs."""
        if states.ndim != 2 or states.shape[1] != len(self.state_names):
            raise ValueError(f"The states have the shape {states.shape}; give (instants, {len(self.state_names)}).")
        values = np.ascontiguousarray(states[:, self._order], dtype=np.float64)
        given = self._vector(inputs, self.input_names, "inputs")
        derivative = np.empty(len(self.state_names))
        outputs = np.empty((len(states), len(self.output_names)))
        place, u, x_dot, y = (array.ctypes.data for array in (values, given, derivative, outputs))
        for row in range(len(states)):
            self._derivative(
                place + row * values.strides[0], u, self._constants_address, x_dot, y + row * outputs.strides[0]
            )
        return outputs

    def play(
        self,
        state: ArrayLike,
        commands: ArrayLike,
        *,
        sample_interval: float,
        substeps: int,
        method: Method = Method.RUNGE_KUTTA_4,
        bounds: ArrayLike | None = None,
        state_every: int | None = None,
    ) -> Playback:
        """Integrate over a record of commands (inputs, samples + 1) with a fixed step, `substeps` to a sample.

        Commands are linear between samples, `sample_interval` in s apart; the extra sample is the one after the record:
        the first of the next chunk, or the last once more. Playing consecutive chunks, each from the state the last one
        ended in, gives the bits of one call. `bounds` are the largest magnitudes of the states, checked at the samples;
        any finite ones by default. With `state_every`, the states after each such number of samples are returned,
        too. Raises `ValueError` when an array has the wrong shape, a command is not finite, or a number is out of its
        range.
        """
        count = len(self.state_names)
        inner = np.zeros(padded(count))
        inner[:count] = self._vector(state, self.state_names, "state")[self._order]
        command = self._commands(commands)
        self._check_steps(sample_interval, substeps)
        limits = self._checked_bounds(bounds)
        samples = command.shape[1] - 1
        outputs = np.empty((len(self.output_names), samples))
        play, every = self._play[method], state_every or max(samples, 1)
        at, given, found = inner.ctypes.data, command.ctypes.data, outputs.ctypes.data
        passed: list[np.ndarray] = []
        for begin in range(0, max(samples, 1), every):
            status = play(
                at,
                given + command.itemsize * begin,
                command.shape[1],
                found + outputs.itemsize * begin,
                samples,
                min(every, samples - begin),
                int(substeps),
                sample_interval / substeps,
                limits.address,
                self._constants_address,
            )
            passed.append(inner[self._places])
            if status != COMPLETED:
                outside = self._states_outside(passed[-1], limits.magnitudes)
                end = begin + int(status)
                return Playback(np.ascontiguousarray(outputs[:, :end]), passed[-1], end, outside)
        return Playback(outputs, passed[-1], None, (), tuple(passed) if state_every is not None else ())

    def _checked_bounds(self, bounds: ArrayLike | None) -> _Bounds:
        content = b"" if bounds is None else np.asarray(bounds, dtype=np.float64).tobytes()
        last = self._bounds
        if last is None or last.content != content:
            magnitudes = self._limits(bounds)
            inner = np.ones(padded(len(magnitudes)))
            inner[: len(magnitudes)] = magnitudes[self._order]
            last = self._bounds = _Bounds(content, magnitudes, inner, inner.ctypes.data)
        return last
