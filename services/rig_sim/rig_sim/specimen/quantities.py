"""What a channel can carry, and the unit it is told in."""

from __future__ import annotations

from enum import StrEnum


class Quantity(StrEnum):
    """What a channel carries."""

    ACCELERATION = "acceleration"
    DISPLACEMENT = "displacement"
    FORCE = "force"
    MOMENT = "moment"
    RATIO = "ratio"
    VELOCITY = "velocity"


UNIT_OF = {
    Quantity.ACCELERATION: "m/s^2",
    Quantity.DISPLACEMENT: "m",
    Quantity.FORCE: "N",
    Quantity.MOMENT: "N*m",
    Quantity.RATIO: "1",
    Quantity.VELOCITY: "m/s",
}
