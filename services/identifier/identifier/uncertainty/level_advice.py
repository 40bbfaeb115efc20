"""Drive levels for an identification: those whose responses are like the target's, within the limits.

A rig with friction, bushings and valves has another FRF at another level, and the iteration starts from the model: the
rig must be identified near its working level.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_loads import DAMAGE_EXPONENTS, channel_damage
from duralab_settings import SettingsError
from duralab_spectra import as_record, dynamic_part, pseudo_inverse
from identifier.uncertainty.valid_band import ValidBand

CREST_FACTOR = 4.5
"""Default peak over RMS with enough room: Gaussian noise exceeds it about once in 150 000 samples."""

# Remainder of a record after the subtraction of its static part, as a share of its largest value.
_ROUNDING = 1e-14


@dataclass(frozen=True)
class LevelAdvice:
    """RMS levels for the drives of an identification, each in its drive's unit.

    `rms`: Shape (drives): proposed, the smaller of the next two. `wanted_rms`: Shape (drives): RMS of the drive that
    gives the target by the model. `largest_rms`: Shape (drives): RMS at which a drive of that crest factor just reaches
    its limit. `response_ratio`: Shape (responses): RMS of each response expected at the proposed levels, over the
    target's. `target_damage`: Shape (responses, 3): pseudo-damage of the target as measured for S-N lines of slope 3, 5
    and 8.
    """

    rms: NDArray[np.float64]
    wanted_rms: NDArray[np.float64]
    largest_rms: NDArray[np.float64]
    response_ratio: NDArray[np.float64]
    target_damage: NDArray[np.float64]

    @property
    def limited(self) -> NDArray[np.bool_]:
        """Whether the limit and not the target determines each level, shape (drives)."""
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
    """Propose the levels whose responses are like a target's.

    Parameters
    ----------
    target
        Shape (responses, samples), at the model's sample rate. Its static part, the line from its level at the start to
        that at the end, is left out.
    frf
        Complex, shape (lines, responses, drives), of full column rank in the band.
    band
        Band of the target, within the model's band.
    room
        Shape (drives), greater than 0: largest magnitude that each drive's limits allow, in its unit.
    crest_factor
        Peak over RMS with enough room, 1 or more.
    laid
        Shape (lines): lines of the FRF that were interpolated, not estimated. None: no such lines.

    Returns
    -------
    LevelAdvice
        Levels for each drive.

    Raises
    ------
    SettingsError
        The target has other channels than the model or does not move in the band, or the crest factor is below 1.
    ValueError
        A drive has no room.
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
    # A constant record leaves its rounding.
    still = np.flatnonzero(target_rms <= _ROUNDING * np.max(np.abs(record), axis=1))
    if still.size:
        raise SettingsError(
            f"The target of response {still[0]} does not move from {band.lowest:g} to "
            f"{band.highest:g} Hz; every response needs a target there.",
            field="target",
        )
    # Each response is weighted by its own size, so that one in newtons does not outweigh one in newton metres.
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

    Exact for a linear rig without noise if all levels change by one factor; otherwise the responses keep the shape of
    their cycles and change in size.

    `damage`: Shape (responses, exponents), of `DAMAGE_EXPONENTS`: damage of the experiment. `frf`: Shape (lines,
    responses, drives). `drive_psd`: Shape (lines, drives): PSD of the experiment's drives. `levels`: Shape (drives):
    levels over those of the experiment.
    Returns: Damage in the shape of `damage`.
    """
    power = np.einsum("fij,fj->ij", np.abs(frf) ** 2, drive_psd)
    before = power.sum(axis=1)
    after = power @ np.square(levels)
    size = np.sqrt(np.divide(after, before, out=np.zeros_like(before), where=before > 0.0))
    return damage * size[:, None] ** np.array(DAMAGE_EXPONENTS)


def _rms(lines: NDArray[np.complex128], samples: int) -> NDArray[np.float64]:
    """Return the RMS of each channel from its one-sided spectrum, (lines, channels), without mean and Nyquist line."""
    return np.sqrt(2.0 * np.sum(np.abs(lines) ** 2, axis=0)) / samples
