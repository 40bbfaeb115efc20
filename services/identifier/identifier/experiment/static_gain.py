"""Static gain: each drive alone is held up and down after the rest of an experiment until the responses settle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from identifier.estimators import FrfEstimate, ModelWarning, WarningCode
from identifier.excitation import ExperimentSettings

# Rise time of a hold: slow compared with what a rig's drives can follow, and short compared with a hold.
_RISE_SECONDS: Final = 0.5
# Share of a response's largest step: with more change in the used half of a hold it has not settled.
_SETTLED_SHARE: Final = 0.02
# Share of a response's largest step: a greater difference to the FRF at the lowest line is reported.
_CONSISTENT_SHARE: Final = 0.2


@dataclass(frozen=True)
class StaticGain:
    """Static gain of a rig, measured by the holds.

    `gain`, shape (responses, drives): Change of the response at rest over that of the drive, response unit per drive
    unit. `unsettled`, shape (responses): Change during the used half of the holds over the response's largest step, 0
    or more.
    """

    gain: NDArray[np.float64]
    unsettled: NDArray[np.float64]


def static_samples(settings: ExperimentSettings, *, drives: int, sample_rate: float) -> int:
    """Return the number of samples of the holds; 0 if the static gain is not measured."""
    if settings.static_hold == 0.0:
        return 0
    return drives * (4 * _rise_samples(sample_rate) + 2 * _hold_samples(settings, sample_rate))


def with_static_steps(
    drive: NDArray[np.float64], settings: ExperimentSettings, *, sample_rate: float
) -> NDArray[np.float64]:
    """Append the holds to a drive, shape (drives, samples), that ends at 0; each holds its own largest magnitude."""
    if settings.static_hold == 0.0:
        return drive
    rise, hold = _rise_samples(sample_rate), _hold_samples(settings, sample_rate)
    up = np.sin(0.5 * np.pi * np.arange(rise, dtype=np.float64) / rise) ** 2
    down = np.cos(np.pi * np.arange(2 * rise) / (2 * rise))
    step = np.concatenate([up, np.ones(hold), down, -np.ones(hold), -up[::-1]])
    heights = np.max(np.abs(drive), axis=1)
    result = np.concatenate([drive, np.kron(np.diag(heights), step)], axis=1, dtype=np.float64)
    result.setflags(write=False)
    return result


def measured_static_gain(
    drive: NDArray[np.float64], response: NDArray[np.float64], settings: ExperimentSettings, *, sample_rate: float
) -> StaticGain | None:
    """Return the static gain from a whole record, or None if there are no holds.

    The second half of each hold is averaged. The difference of up and down is used, so that the rig's load at rest has
    no effect on the gain, and friction acts on both equally.
    """
    drives = drive.shape[0]
    total = static_samples(settings, drives=drives, sample_rate=sample_rate)
    if total == 0:
        return None
    rise, hold = _rise_samples(sample_rate), _hold_samples(settings, sample_rate)
    middle, three_quarters = hold // 2, (3 * hold) // 4
    early, late = np.empty((2, response.shape[0], drives))
    heights = np.empty(drives)
    for j in range(drives):
        start = drive.shape[1] - total + j * (total // drives)
        up, down = start + rise, start + 3 * rise + hold
        heights[j] = drive[j, up]
        for part, (first, last) in ((early, (middle, three_quarters)), (late, (three_quarters, hold))):
            of_up, of_down = (response[:, at + first : at + last].mean(axis=1) for at in (up, down))
            part[:, j] = 0.5 * (of_up - of_down)
    step = 0.5 * (early + late)
    largest = np.max(np.abs(step), axis=1)
    change = np.max(np.abs(late - early), axis=1)
    return StaticGain(
        gain=step / heights, unsettled=np.divide(change, largest, out=np.zeros_like(change), where=largest > 0.0)
    )


def static_warnings(static: StaticGain | None, estimate: FrfEstimate, *, hold: float) -> tuple[ModelWarning, ...]:
    """Warn of responses that have not settled, and of those whose static gain does not continue the FRF."""
    if static is None:
        return ()
    warnings: list[ModelWarning] = []
    first = int(np.flatnonzero(estimate.valid)[0])
    power = np.sqrt(np.einsum("jj->j", estimate.s_uu[first]).real)
    moved = np.max(np.abs(static.gain * power), axis=1)
    away = np.max(np.abs((static.gain - estimate.frf[first].real) * power), axis=1)
    for i in range(moved.size):
        if static.unsettled[i] > _SETTLED_SHARE:
            warnings.append(
                ModelWarning(
                    WarningCode.STATIC_GAIN,
                    f"Response {i} still changed by {100 * static.unsettled[i]:.1f} % of its step while drives were "
                    f"held for {hold:g} s, so that its static gain is not at rest; hold them longer (static_hold).",
                    channel=i,
                )
            )
        if away[i] > _CONSISTENT_SHARE * moved[i] > 0.0:
            frequency = float(estimate.frequency[first])
            warnings.append(
                ModelWarning(
                    WarningCode.STATIC_GAIN,
                    f"Response {i} has a static gain that differs by {100 * away[i] / moved[i]:.0f} % from the FRF at "
                    f"{frequency:.3g} Hz, between which it is laid straight; excite from a lower frequency in longer "
                    "blocks.",
                    channel=i,
                )
            )
    return tuple(warnings)


def _rise_samples(sample_rate: float) -> int:
    return max(1, round(_RISE_SECONDS * sample_rate))


def _hold_samples(settings: ExperimentSettings, sample_rate: float) -> int:
    # At least a quarter of a hold is averaged.
    return max(4, round(settings.static_hold * sample_rate))
