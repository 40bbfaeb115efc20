"""Wear of a specimen: losses of its parts with accumulated damage, and drift of sensor gains.

Damage is a Miner sum (Palmgren 1924, Miner 1945) of the part's own load: each rainflow cycle of range S counts
`(S / reference_range) ** exponent / reference_cycles`, so that damage 1 is `reference_cycles` of `reference_range`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, Discriminator, Field, Tag, model_validator

from rig_sim.parameters import STRICT, Finite, Name, NotNegative, Positive
from rig_sim.specimen.parts import MirroredPart
from rig_sim.specimen.responses import Axis

#: Lost share, always below 1: without the part its body would fall.
Share = Annotated[float, Field(ge=0.0, le=0.95)]


class WearKind(StrEnum):
    """Kind of wear."""

    SOFTENING = "softening"
    CRACK = "crack"
    GAIN_DRIFT = "gain_drift"


class Load(StrEnum):
    """Counted load of a part."""

    #: Force in N of a bushing on its mount, along `axis` of frame A, including rubber.
    FORCE = "force"
    #: Deflection in m of a bushing along `axis` of frame A, of a link or strut along itself.
    DEFLECTION = "deflection"


class BushingPlace(BaseModel):
    """A bushing of the SDF, with all rubber between the same two frames."""

    model_config = STRICT

    frame_a: str
    frame_c: str
    #: Direction of the counted load. The loss is in all directions.
    axis: Axis


class LinkPlace(BaseModel):
    """A link: the spring of the SDF between two bodies."""

    model_config = STRICT

    body_a: str
    body_b: str


class StrutPlace(BaseModel):
    """A strut of the YAML; it loses damping only."""

    model_config = STRICT

    strut: str


_PLACES = {"frame_a": "a bushing", "body_a": "a link", "strut": "a strut"}
#: Names of the places, which pydantic adds to the path of an error; they are not keys of the YAML.
PLACES = frozenset(_PLACES.values())


def _place(document: Any) -> str:
    keys = document if isinstance(document, dict) else vars(document) if isinstance(document, BaseModel) else {}
    return next((place for key, place in _PLACES.items() if key in keys), _PLACES["frame_a"])


Place = Annotated[
    Annotated[BushingPlace, Tag(_PLACES["frame_a"])]
    | Annotated[LinkPlace, Tag(_PLACES["body_a"])]
    | Annotated[StrutPlace, Tag(_PLACES["strut"])],
    Discriminator(_place),
]


class _PartWear(MirroredPart):
    """Wear of a part by the damage of its load; a mirrored one has a damage for each side."""

    part: Place
    load: Load
    #: Slope k of the S-N line.
    exponent: Annotated[float, Field(ge=1.0, le=20.0)]
    #: Range of a load cycle, in N or m, and number of such cycles for damage 1.
    reference_range: Positive
    reference_cycles: Positive
    #: Lost shares of all stiffness and of all damping of the part: at damage 1, or by a crack at once.
    stiffness_lost: Share = 0.0
    damping_lost: Share = 0.0

    @model_validator(mode="after")
    def _loses_something(self) -> Self:
        if self.stiffness_lost == 0.0 and self.damping_lost == 0.0:
            raise ValueError(f"{self.name!r} loses nothing; give stiffness_lost or damping_lost above 0")
        if isinstance(self.part, StrutPlace) and self.stiffness_lost > 0.0:
            raise ValueError(f"{self.name!r} is of a strut, which loses damping only; leave out stiffness_lost")
        return self

    def grown(self, damage: float) -> float:
        """Return the share, 0 to 1, of `stiffness_lost` and `damping_lost` at a damage."""
        raise NotImplementedError


class Softening(_PartWear):
    """Stiffness and damping that fade as damage accumulates, up to damage 1; a failed part loses no more."""

    kind: Literal[WearKind.SOFTENING]
    #: Damage without loss.
    from_damage: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    #: Exponent of the growth: 1 is linear in damage, a larger one is late and steep.
    growth: Annotated[float, Field(ge=0.1, le=20.0)] = 1.0

    def grown(self, damage: float) -> float:
        """Return the share of the loss at a damage."""
        return min(max((damage - self.from_damage) / (1.0 - self.from_damage), 0.0), 1.0) ** self.growth


class Crack(_PartWear):
    """Stiffness and damping that are lost at once, when damage passes `at_damage`."""

    kind: Literal[WearKind.CRACK]
    at_damage: Positive

    def grown(self, damage: float) -> float:
        """Return 1 if the part is cracked."""
        return float(damage >= self.at_damage)


class GainDrift(BaseModel):
    """A sensor whose gain grows (or, negative, falls) by a share for each run, or for each played hour."""

    model_config = STRICT

    kind: Literal[WearKind.GAIN_DRIFT]
    name: Name
    channel: str
    per_run: Finite | None = None
    per_hour: Finite | None = None
    #: Played hours without a change of the gain.
    from_hours: NotNegative = 0.0

    @model_validator(mode="after")
    def _has_one_rate(self) -> Self:
        if (self.per_run is None) == (self.per_hour is None):
            raise ValueError(f"{self.name!r} must have per_run or per_hour, and not both")
        return self


PartWear = Softening | Crack
Wear = Annotated[PartWear | GainDrift, Field(discriminator="kind")]
