"""Check whether the level of an identification ruined its model, from the identification's own record."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LARGEST_MISS = 0.25
"""Largest RMS of the prediction error for a further response of the same level, over the RMS of that response."""

GOOD_MISS = 0.1
"""The same for a raised level: distortion that grows with the level stays far from `LARGEST_MISS`."""


@dataclass(frozen=True)
class LevelCheck:
    """Prediction error of a model for another record at the level of its identification.

    Parameters
    ----------
    miss
        Shape (responses), 0 or more: RMS of the error of the prediction over the RMS of the response.
    noise
        Shape (responses): share of `miss` that is noise, 0 to 1; None if the record does not show it.
    """

    miss: NDArray[np.float64]
    noise: NDArray[np.float64] | None

    @property
    def ruined(self) -> NDArray[np.bool_]:
        """Whether the model's error is too large to be used, shape (responses)."""
        return self.miss > LARGEST_MISS

    @property
    def largest_factor(self) -> float:
        """Largest factor on the level that keeps the miss small, if it grows with the level as for arcs.

        It is below 1 only for a level that ruined the model: a smaller miss may be friction, whose share grows as the
        level falls.
        """
        distortion = self.miss if self.noise is None else self.miss * np.sqrt(1.0 - self.noise**2)
        worst = float(np.max(distortion))
        factor = GOOD_MISS / worst if worst > 0.0 else np.inf
        return factor if worst > LARGEST_MISS else max(factor, 1.0)


def check_level(
    *,
    lines: NDArray[np.bool_],
    residual_psd: NDArray[np.float64],
    response_psd: NDArray[np.float64],
    random_share: NDArray[np.float64],
    noise_psd: NDArray[np.float64] | None = None,
) -> LevelCheck:
    """Predict the error of a model for a further record, as cross-validation would find it.

    Parameters
    ----------
    lines
        Shape (lines): lines of the estimate, one or more.
    residual_psd
        Shape (lines, responses): noise and distortion that the drives do not explain, without the bias of the fit.
    response_psd
        Shape (lines, responses); a response without power has no miss.
    random_share
        Shape (lines), 0 or more: power that the random error of the FRF puts into a prediction, over the residual:
        ``tr(S_uu P)``, `P` the covariance of a row for a residual of 1; of H1 drives over averages.
    noise_psd
        Shape (lines, responses): noise in each averaged item; None if it is not known.

    Returns
    -------
    LevelCheck
        Check of each response.

    Notes
    -----
    A further record has the same residual, and in addition the random error of the FRF. That is the average result of
    leaving out one piece after the other, and needs no pieces to spare.
    """
    residual, response = residual_psd[lines], np.sum(response_psd[lines], axis=0)
    missed = np.sum(residual * (1.0 + random_share[lines, None]), axis=0)
    noise = None
    if noise_psd is not None:
        total = np.sum(residual, axis=0)
        of_noise = np.sum(noise_psd[lines], axis=0)
        noise = np.sqrt(np.clip(np.divide(of_noise, total, out=np.zeros_like(total), where=total > 0.0), 0.0, 1.0))
    share = np.divide(missed, response, out=np.zeros_like(missed), where=response > 0.0)
    return LevelCheck(miss=np.sqrt(share), noise=noise)


def level_sentence(check: LevelCheck, *, drive_rms: NDArray[np.float64], room: NDArray[np.float64]) -> str:
    """Return a sentence with the level that ruined the model and the remedy; channels by number.

    `check`: Check with a ruined response. `drive_rms`: Shape (drives), each in its unit. `room`: Shape (drives),
    greater than 0: half of the range of each drive.
    Returns: One sentence.
    """
    worst = int(np.argmax(check.miss))
    used = drive_rms / room
    # Drives with the smallest use of their range did not drive the rig out of its linear range.
    group = np.flatnonzero(used >= 0.5 * np.max(used))
    levels = " and ".join(f"drive {index} ({drive_rms[index]:.3g} RMS)" for index in group)
    what = (
        f"The model misses {100.0 * check.miss[worst]:.0f} % of response {worst} in a further record of this level, at "
        f"most {100.0 * LARGEST_MISS:.0f} % is good"
    )
    if check.noise is not None and check.noise[worst] ** 2 > 0.5:
        return f"{what}; most of it is noise: raise the level of {levels}, or take a longer experiment."
    if check.noise is not None:
        return f"{what}; most of it is distortion: lower the level of {levels} to {check.largest_factor:.2g} times."
    return (
        f"{what}: noise, distortion and leakage together; lower the level of {levels} to {check.largest_factor:.2g} "
        "times, and raise it if the model misses more there."
    )
