"""What an element does to the rig at one instant: wrenches on bodies, forces on joints, rates of its own states."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from rig_sim.multibody.kinematics import Motion
from rig_sim.multibody.spatial import Array, Spatial


@dataclass
class Line:
    """A hydraulic supply as the actuators meet it: pressures in Pa, and what they have drawn so far, in m^3/s."""

    pressure: Any
    back: Any
    drawn: Any = 0.0


@dataclass
class Effect:
    """Sum of what the elements do; elements add to it.

    `wrenches`: Wrench on each body about the world's origin, in N*m and N. `joint_forces`: Generalised force on each
    freedom, in N or N*m. `monitored`: Named values beside the responses, e.g. a valve's opening. `lines`: Hydraulic
    supplies by name, offered before any element is applied; elements add what they draw.
    """

    wrenches: list[Spatial]
    joint_forces: list[Any]
    monitored: dict[str, Any] = field(default_factory=dict)
    lines: dict[str, Line] = field(default_factory=dict)

    def between(self, body_a: int, body_b: int, wrench: Spatial) -> None:
        """Apply a wrench to body b and its reaction to body a."""
        self.wrenches[body_b] = self.wrenches[body_b] + wrench
        self.wrenches[body_a] = self.wrenches[body_a] - wrench


@dataclass(frozen=True)
class Input:
    """One input of an element: the drive channel it is, and that channel's unit.

    `name`: Name of the drive channel. `unit`: Unit of that channel.
    """

    name: str
    unit: str


class Element(Protocol):
    """A force element or actuator with states of its own."""

    @property
    def name(self) -> str:
        """Name, unique in the rig."""
        ...

    @property
    def initial_state(self) -> tuple[float, ...]:
        """Own states at design position and rest."""
        ...

    @property
    def settles(self) -> bool:
        """Whether the own states have one value at rest; friction and a standing tyre keep any."""
        ...

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The drives this element takes, in the order in which `apply` gets them."""
        ...

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Add this element's wrenches and forces to `effect`, given its inputs' values; return its states' rates."""
        ...


@runtime_checkable
class Offering(Protocol):
    """An element that others draw from: it offers before any is applied, and stands behind all who draw."""

    def offer(self, state: Array, effect: Effect) -> None:
        """Put into `effect` what this element's own states alone decide."""
        ...
