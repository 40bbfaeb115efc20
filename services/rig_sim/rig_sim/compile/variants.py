"""Variants of one structure: their common graph, and the constants in which they may differ.

Two models have one structure if they are the same operations on the same inputs, with any constants. Their common graph
has a node for every tuple of corresponding nodes, one of each variant: if one variant shares a node because two of its
constants happen to be equal, and another does not, the common graph does not share it. So it is correct for every
variant. Its constants are inputs: the code is one for all, and a table has the values of each rig.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig_sim.compile.operations import COMMUTATIVE, Operation
from rig_sim.compile.tracing import Expression, Graph, TracedModel, creation_order, rebuilt

Nodes = tuple[Expression, ...]
_PREFIX = "constant."


@dataclass(frozen=True)
class Fingerprint:
    """Structure of a traced model: `digest` of the whole, and of each node by its index."""

    digest: bytes
    nodes: dict[int, bytes]


@dataclass(frozen=True)
class Variants:
    """United models of one structure: `constants` are leaves, `values` (constants, variants) their numbers."""

    traced: TracedModel
    constants: tuple[Expression, ...]
    values: np.ndarray


def fingerprint(traced: TracedModel) -> Fingerprint:
    """Return the structure of a model; models with equal digests have one structure."""
    nodes: dict[int, bytes] = {}
    for node in creation_order((*traced.state, *traced.inputs, *traced.derivative, *traced.outputs)):
        parts = [nodes[operand.index] for operand in node.operands]
        if node.operation in COMMUTATIVE:
            parts.sort()
        said = f"{node.operation.value} {node.name}\n".encode()
        nodes[node.index] = hashlib.blake2b(said + b"".join(parts), digest_size=16).digest()
    whole = hashlib.blake2b(digest_size=16)
    for group in (traced.state, traced.inputs, traced.derivative, traced.outputs):
        whole.update(f"{len(group)}\n".encode())
        for expression in group:
            whole.update(nodes[expression.index])
    return Fingerprint(whole.digest(), nodes)


def unite(models: Sequence[TracedModel], fingerprints: Sequence[Fingerprint]) -> Variants:
    """Return the united model of models with one structure; raises `ValueError` if their structures differ."""
    if len({each.digest for each in fingerprints}) != 1:
        raise ValueError("The models to unite have different structures; unite those of one fingerprint.")
    results = [(*traced.derivative, *traced.outputs) for traced in models]
    tuples, operands = _tuples(list(zip(*results, strict=True)), fingerprints)
    graph = Graph()
    made: dict[tuple[int, ...], Expression] = {}
    constants: list[Expression] = []
    values: list[list[float]] = []
    for leaf in (*models[0].state, *models[0].inputs):
        graph.input(leaf.name)
    # In the first variant's order of creation, so that operands come first.
    for key in sorted(tuples):
        first = tuples[key][0]
        if first.operation is Operation.CONSTANT:
            made[key] = graph.input(f"{_PREFIX}{len(constants)}")
            constants.append(made[key])
            values.append([float(node) for node in tuples[key]])
        elif first.operation is Operation.INPUT:
            made[key] = graph.input(first.name)
        else:
            made[key] = graph.apply(first.operation, *(made[operand] for operand in operands[key]))

    def united(group: str) -> tuple[Expression, ...]:
        rows = zip(*(getattr(traced, group) for traced in models), strict=True)
        return tuple(made[_key(row)] if _key(row) in made else graph.input(row[0].name) for row in rows)

    traced = TracedModel(united("state"), united("inputs"), united("derivative"), united("outputs"))
    return Variants(traced, tuple(constants), np.array(values).reshape(len(constants), len(models)))


def _key(nodes: Nodes) -> tuple[int, ...]:
    return tuple(node.index for node in nodes)


def _tuples(
    results: Sequence[Nodes], fingerprints: Sequence[Fingerprint]
) -> tuple[dict[tuple[int, ...], Nodes], dict[tuple[int, ...], list[tuple[int, ...]]]]:
    """Return the corresponding nodes of the variants, and those of their operands."""
    found: dict[tuple[int, ...], Nodes] = {}
    operands: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    pending = list(results)
    while pending:
        nodes = pending.pop()
        key = _key(nodes)
        if key in found:
            continue
        found[key] = nodes
        sides = [_operands(node, each) for node, each in zip(nodes, fingerprints, strict=True)]
        together = list(zip(*sides, strict=True))
        operands[key] = [_key(operand) for operand in together]
        pending.extend(together)
    return found, operands


def _operands(node: Expression, marks: Fingerprint) -> Nodes:
    """Return a node's operands in the order that is common to all variants; their order in a sum may differ."""
    if node.operation in COMMUTATIVE:
        return tuple(sorted(node.operands, key=lambda operand: marks.nodes[operand.index]))
    return node.operands


def fused(traced: TracedModel) -> TracedModel:
    """Return the model with products that are used only in one sum fused with it: one operation, one rounding.

    Done here and not by the compiler as for a single rig: fusion must not depend on a vector's width.
    """
    results = (*traced.derivative, *traced.outputs)
    uses = Counter(operand.index for node in creation_order(results) for operand in node.operands)
    uses.update(result.index for result in results)

    def with_products(graph: Graph, node: Expression, operands: list[Expression]) -> Expression:
        if node.operation in {Operation.ADD, Operation.SUBTRACT}:
            # Of two products the one made last, because the other is available earlier.
            for place in sorted((0, 1), key=lambda place: -node.operands[place].index):
                product = operands[place]
                if product.operation is Operation.MULTIPLY and uses[node.operands[place].index] == 1:
                    return _fused_sum(graph, product, operands[1 - place], node=node, place=place)
        return graph.apply(node.operation, *operands)

    return rebuilt(traced, with_products)


def _fused_sum(graph: Graph, product: Expression, other: Expression, *, node: Expression, place: int) -> Expression:
    a, b = product.operands
    if node.operation is Operation.SUBTRACT:
        if place == 1:
            a = -a
        else:
            other = -other
    return graph.apply(Operation.FUSED, a, b, other)
