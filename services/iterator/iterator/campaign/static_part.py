"""The static part of a target: what of it the rig does not carry at rest, and how far it drifts."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_proto.arrays import from_array
from duralab_proto.v1 import rig_pb2
from duralab_spectra import rms
from iterator.band import ControlBand

# Relative to the RMS of what is reproduced; less is not reported.
_REPORTED_SHARE: Final = 0.1


def static_remarks(
    target: NDArray[np.float64],
    target_in_band: NDArray[np.float64],
    *,
    band: ControlBand,
    description: rig_pb2.RigDescription,
) -> tuple[str, ...]:
    """Say which static part of the target is not reproduced: a model in a band tells nothing of 0 Hz."""
    levels = band.static_levels(target)
    rest = from_array(description.static_response, field="static_response", shape=(target.shape[0],), dtype=np.float64)
    dynamic = rms(target_in_band)
    offset, drift = levels.mean(axis=1) - rest, levels[:, 1] - levels[:, 0]
    remarks: list[str] = []
    for values, beginning in (
        (
            offset,
            "The static part of the target is not reproduced, the rig keeps what it carries at rest; it differs by",
        ),
        (drift, "The static part of the target drifts from start to end, which is not reproduced; it drifts by"),
    ):
        reported = np.flatnonzero((dynamic > 0.0) & (np.abs(values) > _REPORTED_SHARE * dynamic))
        # Three digits, without an exponent: -3100, not -3.1e+03.
        parts = (
            f"{float(f'{values[i]:.3g}'):+g} {description.responses[i].unit} in {description.responses[i].name}"
            for i in reported
        )
        if reported.size:
            remarks.append(f"{beginning} {', '.join(parts)}.")
    return tuple(remarks)
