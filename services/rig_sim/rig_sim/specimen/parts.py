"""Parts of which the YAML names only the left one: the right one is its mirror image."""

from __future__ import annotations

import re
from typing import Self

from pydantic import BaseModel, model_validator

from rig_sim.parameters import STRICT, Name

#: Beginning of the name of a mirrored part, replaced by `right_` in the mirror image.
LEFT = "left_"
RIGHT = "right_"


def mirrored_name(name: str) -> str:
    """Return the name of the right one of a pair: `rear_left_wheel` becomes `rear_right_wheel`; others are equal."""
    return re.sub(f"(^|_){LEFT}", rf"\g<1>{RIGHT}", name, count=1)


class MirroredPart(BaseModel):
    """A part with a name; one of a pair if it is mirrored."""

    model_config = STRICT

    name: Name
    #: Only the left one is written; the right one is its mirror image in the plane y = 0.
    mirrored: bool = False

    @model_validator(mode="after")
    def _is_on_the_left(self) -> Self:
        if self.mirrored and mirrored_name(self.name) == self.name:
            raise ValueError(f"{self.name!r} is mirrored, so its name must begin with {LEFT!r} or hold '_{LEFT}'")
        return self
