"""The order in which a graph's expressions are evaluated; what no result needs is left out."""

from collections.abc import Iterable

from rig_sim.compile.tracing import Expression


def creation_order(results: Iterable[Expression]) -> list[Expression]:
    """Return every expression that a result depends on, operands first, in the order in which the model made them.

    A model computes things where it uses them, and interleaves independent sums; on graphs of 4,000 to 10,000
    operations this order ran 1 to 3 % faster than depth-first from the results and 5 to 20 % faster than depth-first
    with the fewest live values (Sethi and Ullman, 1970), whose long dependent chains keep the processor waiting.
    It depends on the model alone: the same model gives the same code in every process.
    """
    found: dict[int, Expression] = {}
    pending = list(results)
    while pending:
        expression = pending.pop()
        if expression.index not in found:
            found[expression.index] = expression
            pending.extend(expression.operands)
    return [found[index] for index in sorted(found)]
