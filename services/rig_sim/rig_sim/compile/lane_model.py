"""Write a whole model in lanes, where it has a mirror and lanes save operations."""

from __future__ import annotations

from dataclasses import dataclass

from rig_sim.compile.lane_text import LaneFunction, lane_function_text
from rig_sim.compile.lanes import is_worthwhile
from rig_sim.compile.llvm_text import PAIR, declarations
from rig_sim.compile.packing import plan_lanes
from rig_sim.compile.symmetry import Mirror, find_mirrors
from rig_sim.compile.traced_model import TracedModel
from rig_sim.compile.tracing import Expression

Pair = tuple[int, int]


@dataclass(frozen=True)
class LaneTexts:
    """The functions of a model in lanes.

    `text`: LLVM IR of ``derivative`` and ``observe``, whose state and derivative have the order below. `state_order`:
    Which state of the model is at each place: the lanes of a pair side by side, then what has no partner.
    """

    text: str
    state_order: tuple[int, ...]


def lane_texts(traced: TracedModel, *, contract: bool) -> LaneTexts | None:
    """Return the model in two lanes; None where no mirror is found with which that saves operations."""
    for mirror in find_mirrors(traced):
        pairs = _state_pairs(traced, mirror)
        order = tuple(place for pair in pairs for place in pair)
        order += tuple(place for place in range(len(traced.state)) if place not in set(order))
        derivative = _function("derivative", traced, mirror, pairs=pairs, order=order)
        if not is_worthwhile(derivative.plan, traced.derivative):
            continue
        observe = _function("observe", traced, mirror, pairs=pairs, order=order)
        try:
            functions = [lane_function_text(function, contract=contract) for function in (derivative, observe)]
        except ValueError:
            continue  # vectors that need each other: as good as no mirror
        return LaneTexts("\n".join([declarations(PAIR), *functions]), order)
    return None


def _state_pairs(traced: TracedModel, mirror: Mirror) -> list[Pair]:
    places = {state.index: place for place, state in enumerate(traced.state)}
    return sorted((places[a.index], places[b.index]) for a, b in mirror.pairs if a.index in places)


def _function(
    name: str, traced: TracedModel, mirror: Mirror, *, pairs: list[Pair], order: tuple[int, ...]
) -> LaneFunction:
    rates = traced.derivative
    paired = [(2 * place, rates[a], rates[b]) for place, (a, b) in enumerate(pairs)]
    single = [(place, rates[order[place]]) for place in range(2 * len(pairs), len(order))]
    outputs = list(enumerate(traced.outputs)) if name == "observe" else []
    output_pairs = _output_pairs([output for _, output in outputs], mirror)
    plan = plan_lanes(
        mirror,
        pairs=[*((a, b) for _, a, b in paired), *output_pairs],
        singles=[*(rate for _, rate in single), *(output for _, output in outputs)],
        side_by_side=[(traced.state[a].index, traced.state[b].index) for a, b in pairs],
    )
    places = {traced.state[at].index: (0, place) for place, at in enumerate(order)}
    places |= {leaf.index: (1, place) for place, leaf in enumerate(traced.inputs)}
    with_outputs = name == "observe"
    return LaneFunction(
        name=name,
        plan=plan,
        places=places,
        arguments=2,
        pairs=(tuple(paired), ()) if with_outputs else (tuple(paired),),
        singles=(tuple(single), tuple(outputs)) if with_outputs else (tuple(single),),
    )


def _output_pairs(outputs: list[Expression], mirror: Mirror) -> list[tuple[Expression, Expression]]:
    """Pair outputs of both sides, the first in lane 0; they are stored one by one, but computed together."""
    partners: dict[int, Expression] = {}
    for output in outputs:
        partners.setdefault(mirror.second[output.index], output)
    found = []
    for output in outputs:
        partner = partners.get(mirror.first[output.index])
        if partner is not None and partner is not output:
            found.append((output, partner))
    return found
