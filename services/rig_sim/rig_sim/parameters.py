"""Types of a specimen's parameters in YAML: unknown keys, wrong signs and infinities are refused at load."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

from duralab_proto.keys import LONGEST_NAME

STRICT = ConfigDict(extra="forbid", frozen=True, defer_build=True)

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
#: Name of a part or a channel.
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
#: Name of a rig, which is part of the bus keys.
RigName = Annotated[Name, Field(max_length=LONGEST_NAME)]
