"""Check of a target against the ranges of a rig's responses before any motion; a wrong unit is found here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_bus import FaultError
from duralab_proto.v1 import iterator_pb2, query_pb2, rig_pb2
from iterator.campaign.static_part import static_response_of

# Share of a response's range; a smaller target is hardly above the sensor's noise.
_TINY_SHARE: Final = 1e-3


def require_reach(
    target_in_band: NDArray[np.float64],
    steps: Sequence[iterator_pb2.TargetStep],
    *,
    description: rig_pb2.RigDescription,
    controlled: NDArray[np.bool_],
) -> None:
    """Refuse a target beyond the range or the watchdog of a response."""
    rest = static_response_of(description)
    found: list[tuple[float, int, float, float, str]] = []
    for i in np.flatnonzero(controlled):
        channel = description.responses[i]
        watchdog = channel.watchdog or np.inf
        for value, limit, sign in (
            (rest[i] + target_in_band[i].max(), channel.maximum, 1.0),
            (rest[i] + target_in_band[i].min(), channel.minimum, -1.0),
        ):
            bound = sign * min(sign * limit, watchdog)
            if sign * value > sign * bound:
                times = value / bound if value * bound > 0.0 else np.inf
                found.append((times, int(i), value, bound, "range" if bound == limit else "watchdog"))
    if not found:
        return
    times, i, value, bound, what = max(found)
    channel = description.responses[i]
    multiple = f", {times:.3g} times the {bound:.3g} {channel.unit}" if np.isfinite(times) else f", beyond {bound:.3g}"
    raise FaultError(
        query_pb2.FAULT_CODE_INVALID_ARGUMENT,
        f"The target of {channel.name} peaks at {value:.3g} {channel.unit}{multiple} of its {what} on rig "
        f"{description.rig!r}, what the rig carries at rest included; {_suspect(channel.name, steps)}",
        field="target.samples",
    )


def _suspect(name: str, steps: Sequence[iterator_pb2.TargetStep]) -> str:
    """Return a question about the most likely cause of a target that is too large."""
    read = next((channel for step in steps[:1] for channel in step.channels if channel.channel == name), None)
    if read is not None and read.stated_unit:
        return f"is `unit: {read.stated_unit}` right for the file's channel {read.source!r}?"
    if read is not None and read.source_unit:
        return f"is the unit {read.source_unit!r} of the file's channel {read.source!r} right, and the channel?"
    return "are its unit, scale and channel right?"


def tiny_target_remarks(
    target_in_band: NDArray[np.float64], *, description: rig_pb2.RigDescription, controlled: NDArray[np.bool_]
) -> tuple[str, ...]:
    """Return a remark on targets so small compared with the range that their unit is doubtful."""
    peaks = np.max(np.abs(target_in_band), axis=1)
    tiny = [
        f"{peaks[i]:.3g} {channel.unit} in {channel.name}"
        for i, channel in enumerate(description.responses)
        if controlled[i] and peaks[i] < _TINY_SHARE * min(-channel.minimum, channel.maximum) < np.inf
    ]
    if not tiny:
        return ()
    return (
        f"The target peaks at less than {100 * _TINY_SHARE:.1f} % of the response's range: {', '.join(tiny)}; are "
        "its unit and scale right?",
    )
