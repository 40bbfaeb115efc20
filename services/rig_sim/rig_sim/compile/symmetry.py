"""Find the mirror in a traced model: the pairs of corresponding states of its two sides.

The method is colour refinement (Weisfeiler and Leman, 1968): leaves (states and inputs) of one colour are separated by
the structure of the expressions around them, until nothing changes. Signs do not count, because a mirror changes
them; of constants at most the magnitude counts. The result is a proposal: lanes are correct for any pairing, but fast
for a good one only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rig_sim.compile.operations import COMMUTATIVE, Operation
from rig_sim.compile.tracing import Expression, TracedModel, creation_order

#: Number of partners that are tried for a leaf with more than two equal ones.
_LARGEST_TRIALS = 12
#: Operations that are equal except for the signs of the operands.
_SUMS = frozenset({Operation.ADD, Operation.SUBTRACT, Operation.NEGATE})
_MASK = 2**64 - 1

Colours = dict[int, int]


@dataclass(frozen=True)
class Mirror:
    """Pairs of leaves, the first of each in lane 0, and colours that are equal for expressions of one vector.

    `pairs`: States and inputs; a leaf in no pair is part of both sides, as a rack or a body. `first`, `second`:
    Colours of all expressions by their index, from the view of lane 0 and of lane 1. `constants`: Indices of the leaves
    that are constants of united variants.
    """

    pairs: tuple[tuple[Expression, Expression], ...]
    first: Colours
    second: Colours
    constants: frozenset[int] = frozenset()

    def is_constant(self, expression: Expression) -> bool:
        """Return whether an expression is a constant."""
        return expression.value is not None or expression.index in self.constants


def find_mirrors(traced: TracedModel, constants: Sequence[Expression] = ()) -> Iterator[Mirror]:
    """Propose mirrors, the most likely first: constants of equal magnitude, then any constants.

    `constants` are the leaves of united variants that are constants: what is proposed then depends on no value, so that
    variants with other values are computed alike.
    """
    nodes = creation_order((*traced.derivative, *traced.outputs))
    for magnitude in (False,) if constants else (True, False):
        model = _Structure(traced, nodes, constants, magnitude=magnitude)
        pairs = _pairing(model, model.refined({leaf.index: 0 for leaf in model.leaves}))
        if pairs:
            yield model.mirror(pairs)


class _Structure:
    """A traced model as a graph with coloured leaves."""

    def __init__(
        self, traced: TracedModel, nodes: Sequence[Expression], constants: Sequence[Expression], *, magnitude: bool
    ) -> None:
        self.leaves = (*traced.state, *traced.inputs)
        self._nodes = nodes
        self._states = {state.index: rate for state, rate in zip(traced.state, traced.derivative, strict=True)}
        self._kinds = {
            node.index: ("constant", f"{abs(node.value):.9e}" if magnitude else "")
            for node in nodes
            if node.value is not None
        }
        self._constants = frozenset(leaf.index for leaf in constants)
        self._kinds |= dict.fromkeys(self._constants, ("constant", ""))
        leaves = {leaf.index for leaf in self.leaves}
        self._users = _users(nodes, leaves)
        # Data that is the same in every colouring.
        self._inner = [
            (node.index, node.operation, tuple(operand.index for operand in node.operands))
            for node in nodes
            if node.index not in leaves
        ]

    def colour(self, leaves: Mapping[int, int], table: dict[object, int] | None = None) -> Colours:
        """Colour all expressions, given colours of the leaves."""
        table = {} if table is None else table
        colours: Colours = {}
        for leaf, colour in leaves.items():
            colours[leaf] = _scatter(table.setdefault(("leaf", colour), len(table)))
        for index, operation, places in self._inner:
            operands = [colours[place] for place in places]
            if operation is Operation.NEGATE:
                colours[index] = operands[0]
            elif operation in _SUMS:
                # The order in a sum does not matter: the colour of a sum is a sum over its terms.
                colours[index] = sum(operands) & _MASK
            else:
                if operation in COMMUTATIVE:
                    operands.sort()
                key = self._kinds.get(index) or (operation, *operands)
                colours[index] = _scatter(table.setdefault(key, len(table)))
        return colours

    def refined(self, leaves: dict[int, int]) -> dict[int, int]:
        """Refine the colours of leaves by the expressions around them, until nothing changes."""
        while True:
            colours = self.colour(leaves)
            table: dict[object, int] = {}
            finer: dict[int, int] = {}
            for leaf, before in leaves.items():
                rate = self._states.get(leaf)
                key = (
                    before,
                    -1 if rate is None else colours[rate.index],
                    tuple(sorted((colours[user], position) for user, position in self._users[leaf])),
                )
                finer[leaf] = table.setdefault(key, len(table))
            if len(table) == len(set(leaves.values())):
                return finer
            leaves = finer

    def mirror(self, pairs: Sequence[tuple[int, int]]) -> Mirror:
        """Put one leaf of every pair into lane 0 and colour the graph from the view of each lane."""
        expressions = {leaf.index: leaf for leaf in self.leaves}
        sides = self._sides(pairs)
        first = {leaf: 3 * index for index, leaf in enumerate(expressions)}
        second = dict(first)
        turned = []
        for a, b in pairs:
            left, right = (a, b) if sides[a] else (b, a)
            turned.append((expressions[left], expressions[right]))
            first[left] = second[right] = 3 * left + 1
            first[right] = second[left] = 3 * left + 2
        table: dict[object, int] = {}  # one for both, so that their colours compare
        return Mirror(tuple(turned), self.colour(first, table), self.colour(second, table), self._constants)

    def _sides(self, pairs: Sequence[tuple[int, int]]) -> dict[int, bool]:
        """Join leaves that meet in the smallest expressions, but never a leaf with its partner."""
        partner = dict(pairs) | {b: a for a, b in pairs}
        reach: dict[int, frozenset[int]] = {}
        groups: set[tuple[int, ...]] = set()
        for node in self._nodes:
            if node.index in self._users:
                reach[node.index] = frozenset((node.index,)) & partner.keys()
            else:
                reach[node.index] = frozenset().union(*(reach[operand.index] for operand in node.operands))
            groups.add(tuple(sorted(reach[node.index])))
        for state, rate in self._states.items():
            if state in partner:
                groups.add(tuple(sorted(reach[rate.index] | {state})))
        component = {leaf: leaf for leaf in partner}
        members = {leaf: {leaf} for leaf in partner}

        def join(a: int, b: int) -> None:
            kept, lost = component[a], component[b]
            if kept == lost or any(partner[leaf] in members[kept] for leaf in members[lost]):
                return
            for leaf in members[lost]:
                component[leaf] = kept
            members[kept] |= members.pop(lost)

        for group in sorted(groups, key=lambda leaves: (len(leaves), leaves)):
            for other in group[1:]:
                if partner[other] != group[0]:
                    join(group[0], other)
                    join(partner[group[0]], partner[other])
        sides: dict[int, bool] = {}
        for a, b in pairs:
            if a not in sides:
                sides |= dict.fromkeys(members[component[a]], True)
                sides |= dict.fromkeys(members[component[b]], False)
        return sides


def _users(nodes: Sequence[Expression], leaves: set[int]) -> dict[int, set[tuple[int, int]]]:
    """Return the users of every leaf, by index and position of the operand; sums in between are passed through."""
    users: dict[int, set[tuple[int, int]]] = {index: set() for index in leaves}
    # Leaves in each sum, directly or through further sums.
    terms: dict[int, set[int]] = {index: {index} for index in leaves}
    for node in nodes:
        for position, operand in enumerate(node.operands):
            reached = terms.get(operand.index, set())
            if node.operation in _SUMS:
                terms.setdefault(node.index, set()).update(reached)
            else:
                for leaf in reached:
                    users[leaf].add((node.index, 0 if node.operation in COMMUTATIVE else position))
    return users


def _scatter(number: int) -> int:
    """Mix a number's bits (splitmix64), so that equal sums come from equal terms."""
    number = (number + 1) * 0x9E3779B97F4A7C15 & _MASK
    number = (number ^ number >> 30) * 0xBF58476D1CE4E5B9 & _MASK
    number = (number ^ number >> 27) * 0x94D049BB133111EB & _MASK
    return number ^ number >> 31


def _pairing(model: _Structure, leaves: dict[int, int]) -> list[tuple[int, int]]:
    """Pair leaves of one colour; if more than two have it, pair the first with the partner that keeps most in pairs."""
    while True:
        classes = _classes(leaves)
        crowd = min((same for same in classes if len(same) > 2), key=len, default=None)
        if crowd is None:
            return [(same[0], same[1]) for same in classes if len(same) == 2]
        # Sides are mostly listed one after the other: the first of the second half is the most likely partner.
        middle = len(crowd) // 2
        candidates = [*crowd[middle:], *crowd[1:middle]][:_LARGEST_TRIALS]
        best: dict[int, int] = {}
        for partner in candidates:
            finer = model.refined(leaves | {crowd[0]: len(leaves), partner: len(leaves)})
            if not best or _alike(finer) > _alike(best):
                best = finer
            if _alike(best) == _alike(leaves):
                break
        leaves = best


def _classes(leaves: dict[int, int]) -> list[list[int]]:
    classes: dict[int, list[int]] = {}
    for leaf, colour in leaves.items():
        classes.setdefault(colour, []).append(leaf)
    return list(classes.values())


def _alike(leaves: dict[int, int]) -> int:
    return sum(len(same) // 2 * 2 for same in _classes(leaves))
