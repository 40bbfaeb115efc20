"""At which drive levels to identify: those that give responses like the target's, as far as the limits allow.

A rig with friction, bushings and valves is another one at another level, and the iteration starts from the model: it is
to be identified near the level at which it will work.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_loads import DAMAGE_EXPONENTS, channel_damage
from duralab_settings import SettingsError
from duralab_spectra import as_record, dynamic_part, pseudo_inverse
from identifier.uncertainty.valid_band import ValidBand

CREST_FACTOR = 4.5
"""Peak over RMS to leave room for, where none is asked for: Gaussian noise passes it about once in 150 000 samples."""

# Of the largest value of a record, what subtracting its static part leaves of it.
_ROUNDING = 1e-14


@dataclass(frozen=True)
class LevelAdvice:
    """RMS levels for the drives of an identification, each in its drive's unit.

    `rms`: Shape (drives): proposed, the smaller of the next two. `wanted_rms`: Shape (drives): of the drive that the
    model says makes the target. `largest_rms`: Shape (drives): at which a drive of that crest factor just reaches its
    limit. `response_ratio`: Shape (responses): RMS of each response expected at the proposed levels, over the target's.
    `target_damage`: Shape (responses, 3): pseudo-damage of the target as measured for S-N lines of slope 3, 5 and 8.
    """

    rms: NDArray[np.float64]
    wanted_rms: NDArray[np.float64]
    largest_rms: NDArray[np.float64]
    response_ratio: NDArray[np.float64]
    target_damage: NDArray[np.float64]

    @property
    def limited(self) -> NDArray[np.bool_]:
        """Shape (drives): whether the limit and not the target decides."""
        return self.wanted_rms > self.largest_rms


def advise_levels(
    target: ArrayLike,
    frf: NDArray[np.complex128],
    *,
    band: ValidBand,
    room: NDArray[np.float64],
    crest_factor: float = CREST_FACTOR,
    laid: NDArray[np.bool_] | None = None,
) -> LevelAdvice:
    """Propose the levels that give responses like a target's.

    Parameters
    ----------
    target
        Shape (responses, samples), at the model's sample rate. Its static part, the line from its level at the start to
        that at the end, is left out.
    frf
        Complex, shape (lines, responses, drives), of full column rank in the band.
    band
        Where the target counts; within the model's.
    room
        Shape (drives), greater than 0: largest magnitude that each drive's limits allow, in its unit.
    crest_factor
        Peak over RMS that is left room for, 1 or more.
    laid
        Shape (lines): lines of the FRF that were interpolated, not estimated. None: no such lines.

    Returns
    -------
    LevelAdvice
        For each drive.

    Raises
    ------
    SettingsError
        Where the target has other channels than the model or does not move in the band, or the crest factor is below 1.
    ValueError
        Where a drive has no room.
    """
    record = as_record(target, name="target")
    responses, drives = frf.shape[1], frf.shape[2]
    if record.shape[0] != responses:
        raise SettingsError(
            f"The target has {record.shape[0]} channels; the model has {responses} responses.", field="target"
        )
    if not 1.0 <= crest_factor < np.inf:
        raise SettingsError(
            f"The crest factor is {crest_factor}; it must be 1 or more and finite.", field="crest_factor"
        )
    if room.shape != (drives,) or not np.all(room > 0.0):
        raise ValueError(f"The limits leave room for {room.tolist()}; every one of {drives} drives needs some.")
    moving = dynamic_part(record, lowest=band.lowest, sample_rate=band.sample_rate)
    spectrum = np.fft.rfft(moving, axis=1)
    frequency = np.arange(spectrum.shape[1]) * (band.sample_rate / record.shape[1])
    inside = band.contains(frequency)
    wished = spectrum[:, inside].T
    target_rms = _rms(wished, record.shape[1])
    # A level by itself leaves its rounding.
    still = np.flatnonzero(target_rms <= _ROUNDING * np.max(np.abs(record), axis=1))
    if still.size:
        raise SettingsError(
            f"The target of response {still[0]} does not move from {band.lowest:g} to "
            f"{band.highest:g} Hz; every response needs a target there.",
            field="target",
        )
    # Each response counts by its own size, so that one in newtons does not outweigh one in newton metres.
    weight = 1.0 / target_rms
    matrix = band.curved_between_lines(frf, frequency[inside], laid=laid)
    inverse = pseudo_inverse(matrix * weight[:, None]) * weight
    needed = np.einsum("fji,fi->fj", inverse, wished)
    wanted = _rms(needed, record.shape[1])
    largest = room / crest_factor
    proposed = np.minimum(wanted, largest)
    scaled = needed * np.divide(proposed, wanted, out=np.zeros(drives), where=wanted > 0.0)
    reached = _rms(np.einsum("fij,fj->fi", matrix, scaled), record.shape[1])
    return LevelAdvice(
        rms=proposed,
        wanted_rms=wanted,
        largest_rms=largest,
        response_ratio=reached / target_rms,
        target_damage=channel_damage(record),
    )


def damage_at_levels(
    damage: NDArray[np.float64], frf: NDArray[np.complex128], *, drive_psd: NDArray[np.float64], levels: ArrayLike
) -> NDArray[np.float64]:
    """Predict the pseudo-damage of an experiment at other drive levels.

    Exact for a linear rig without noise where all levels change alike; otherwise the responses keep the shape of their
    cycles and change in size.

    `damage`: Shape (responses, exponents), of `DAMAGE_EXPONENTS`: of the experiment as it was. `frf`: Shape (lines,
    responses, drives). `drive_psd`: Shape (lines, drives): of the experiment as it was. `levels`: Shape (drives): over
    those of the experiment.
    Returns: As `damage`.
    """
    power = np.einsum("fij,fj->ij", np.abs(frf) ** 2, drive_psd)
    before = power.sum(axis=1)
    after = power @ np.square(levels)
    size = np.sqrt(np.divide(after, before, out=np.zeros_like(before), where=before > 0.0))
    return damage * size[:, None] ** np.array(DAMAGE_EXPONENTS)


def _rms(lines: NDArray[np.complex128], samples: int) -> NDArray[np.float64]:
    """RMS of each channel from its one-sided spectrum, (lines, channels), without mean and Nyquist line."""
    return np.sqrt(2.0 * np.sum(np.abs(lines) ** 2, axis=0)) / samples
