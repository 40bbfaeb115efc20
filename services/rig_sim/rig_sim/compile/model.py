"""Trace and compile a model that is written as one Python function of its state and inputs."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rig_sim.compile.code_cache import shared_model
from rig_sim.compile.compiled_model import CompiledModel, compile_module
from rig_sim.compile.constants import ConstantTable
from rig_sim.compile.expansion import expanded
from rig_sim.compile.integrate import SINGLE_WIDTH, play_text
from rig_sim.compile.lanes import mirrored_model
from rig_sim.compile.llvm_text import DOUBLE, PAIR, declarations, model_text, vector_kind
from rig_sim.compile.operations import LEAVES
from rig_sim.compile.tracing import Expression, Graph, Scalar, TracedModel, creation_order

ModelFunction = Callable[[np.ndarray, np.ndarray], tuple[Sequence[Scalar], Sequence[Scalar]]]


def trace_model(function: ModelFunction, *, state_names: Sequence[str], input_names: Sequence[str]) -> TracedModel:
    """Run a model once on expressions; the names have the order of its arrays.

    ``function(state, inputs) -> (derivative, outputs)`` takes object arrays (states,) and (inputs,) and returns
    sequences of scalars. It uses operators and :mod:`rig_sim.compile.numeric`, and never branches on a value. Raises
    `ValueError` when a name is given twice, or there is not one derivative per state.
    """
    for kind, names in (("state", state_names), ("input", input_names)):
        twice = sorted({name for name in names if list(names).count(name) > 1})
        if twice:
            raise ValueError(f"The {kind} name {twice[0]!r} is given twice; name every {kind} differently.")
    graph = Graph()
    state = tuple(graph.input(f"state.{name}") for name in state_names)
    inputs = tuple(graph.input(f"input.{name}") for name in input_names)
    derivative, outputs = function(_objects(state), _objects(inputs))
    traced = TracedModel(
        state=state,
        inputs=inputs,
        derivative=tuple(graph.expression(value) for value in derivative),
        outputs=tuple(graph.expression(value) for value in outputs),
    )
    if len(traced.derivative) != len(state) or not state:
        raise ValueError(
            f"The model returns {len(traced.derivative)} derivatives for {len(state)} states; return one for each of "
            "at least one state."
        )
    return traced


def compile_model(
    function: ModelFunction,
    *,
    state_names: Sequence[str],
    input_names: Sequence[str],
    output_names: Sequence[str] | None = None,
    contract: bool = True,
    lanes: bool = True,
    optimization: int = 2,
    shared: bool = False,
) -> CompiledModel:
    """Compile a model, see :func:`trace_model`; outputs are called ``output_0``, … by default.

    `contract`: Whether products and sums may be fused into one operation with one rounding: faster, and as exact.
    `lanes`: Whether two sides that mirror each other may be computed as lanes of vectors, if that saves operations.
    `optimization`: 0 to 3, as a compiler's -O. `shared`: Whether the code is stored on disk, and read from there, for
    all models that differ only in their constants' values. Raises `ValueError` if names and results do not match.
    """
    traced = trace_model(function, state_names=state_names, input_names=input_names)
    names = (
        tuple(output_names) if output_names is not None else tuple(f"output_{i}" for i in range(len(traced.outputs)))
    )
    if len(names) != len(traced.outputs):
        raise ValueError(f"The model returns {len(traced.outputs)} outputs for {len(names)} names; name each of them.")
    table = ConstantTable(traced)

    def compiled() -> CompiledModel:
        written = expanded(traced)
        mirrored = mirrored_model(written) if lanes else None
        if mirrored is not None:
            functions = mirrored.text(contract=contract, table=table)
        else:
            functions = model_text(written, contract=contract, table=table)
        loop = play_text(states=len(traced.state), inputs=len(traced.inputs), outputs=len(traced.outputs))
        text = "\n".join([declarations(DOUBLE, PAIR, vector_kind(SINGLE_WIDTH)), functions, loop])
        return CompiledModel(
            compile_module(text, optimization=optimization),
            table.content(table.entries),
            state_names=tuple(state_names),
            input_names=tuple(input_names),
            output_names=names,
            operation_count=sum(node.operation not in LEAVES for node in creation_order(written.derivative)),
            state_order=None if mirrored is None else mirrored.order,
        )

    if not shared:
        return compiled()
    return shared_model(f"{names} {contract} {lanes} {optimization}", table, compiled)


def _objects(expressions: tuple[Expression, ...]) -> np.ndarray:
    array: np.ndarray[Any, Any] = np.empty(len(expressions), dtype=object)
    array[:] = expressions
    return array
