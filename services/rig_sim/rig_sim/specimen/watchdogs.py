"""Limits of a specimen's watchdogs in its YAML, and the watchdogs that they set up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import BaseModel, model_validator

from duralab_gateway.motion import Source, Watchdog
from rig_sim.parameters import STRICT, Finite, Positive


class Range(BaseModel):
    """Where a monitored value has to stay, in its own unit; either end may be open."""

    model_config = STRICT

    minimum: Finite | None = None
    maximum: Finite | None = None

    @model_validator(mode="after")
    def _is_a_range(self) -> Range:
        if self.minimum is None and self.maximum is None:
            raise ValueError("neither minimum nor maximum is given; give at least one")
        if self.minimum is not None and self.maximum is not None and not self.minimum < self.maximum:
            raise ValueError(f"minimum is {self.minimum:g}; it must be below maximum, {self.maximum:g}")
        return self


class WatchdogLimits(BaseModel):
    """Limits of a specimen's watchdogs; what is not named is not watched."""

    model_config = STRICT

    #: Largest magnitude of responses, by channel, in the channel's unit.
    responses: dict[str, Positive] = {}
    #: Largest magnitude of command less achieved value, by drive, in the drive's unit. Leave out an actuator that gives
    #: way under load on purpose.
    following_errors: dict[str, Positive] = {}
    #: Monitored values of the elements, pressures above all, e.g. `left_vertical.load_pressure` (share of the largest).
    monitored: dict[str, Range] = {}


def set_up_watchdogs(
    limits: WatchdogLimits,
    *,
    responses: Mapping[str, str],
    drives: Mapping[str, str],
    followed: Sequence[str],
    monitored: Sequence[str],
) -> tuple[Watchdog, ...]:
    """Find what the limits name among units by channel and monitored values, all in the order of their rows.

    Drives that no actuator follows have no following error. Raises `ValueError` where a name does not exist; the
    sentence lists those that do.
    """
    dogs = []
    for source, given, rows, allowed in (
        (Source.RESPONSE, limits.responses, list(responses), list(responses)),
        (Source.FOLLOWING_ERROR, limits.following_errors, list(drives), list(followed)),
        (Source.MONITORED, limits.monitored, list(monitored), list(monitored)),
    ):
        units = {Source.RESPONSE: responses, Source.FOLLOWING_ERROR: drives, Source.MONITORED: {}}[source]
        for name, limit in given.items():
            if name not in allowed:
                raise ValueError(
                    f"a watchdog is set on the {source} of {name!r}; there are {', '.join(allowed) or 'none'}."
                )
            ends = limit if isinstance(limit, Range) else Range(minimum=-limit, maximum=limit)
            dogs.append(
                Watchdog(
                    source=source,
                    name=name,
                    row=rows.index(name),
                    unit=units.get(name, ""),
                    minimum=-np.inf if ends.minimum is None else ends.minimum,
                    maximum=np.inf if ends.maximum is None else ends.maximum,
                )
            )
    return tuple(dogs)
