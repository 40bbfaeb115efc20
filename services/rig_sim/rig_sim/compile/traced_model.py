"""A model as expressions of its state and inputs."""

from dataclasses import dataclass

from rig_sim.compile.tracing import Expression


@dataclass(frozen=True)
class TracedModel:
    """A model as expressions.

    `state`, `inputs`: The arguments. `derivative`, `outputs`: The results.
    """

    state: tuple[Expression, ...]
    inputs: tuple[Expression, ...]
    derivative: tuple[Expression, ...]
    outputs: tuple[Expression, ...]
