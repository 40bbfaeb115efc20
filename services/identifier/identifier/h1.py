"""The H1 estimator: FRF matrix, multiple coherence and the condition of the drives' cross-spectrum."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spectra import CrossSpectra, SpectraEstimate, as_record

LARGEST_CONDITION = 1e3
"""Condition number of the scaled S_uu above which drives count as correlated: two of coherence 0.996."""


@dataclass(frozen=True)
class FrfEstimate:
    """An estimated FRF matrix with what tells how good it is.

    At lines outside the band nothing is estimated: FRF, coherence and condition number are 0 there.

    Parameters
    ----------
    frequency
        Shape (lines), in hertz, from 0 to half the sample rate.
    frf
        Complex, shape (lines, responses, drives), with ``e^{+j omega t}``.
    coherence
        Multiple coherence, shape (lines, responses), 0 to 1.
    condition_number
        Of ``S_uu`` scaled to unit diagonal, shape (lines), 1 or more in the band.
    s_uu
        Complex, shape (lines, drives, drives), one-sided density.
    response_psd
        Shape (lines, responses), one-sided density.
    blocks
        Blocks averaged (Eq. 10).
    independent_averages
        Equivalent independent blocks (Welch's formula).
    """

    frequency: NDArray[np.float64]
    frf: NDArray[np.complex128]
    coherence: NDArray[np.float64]
    condition_number: NDArray[np.float64]
    s_uu: NDArray[np.complex128]
    response_psd: NDArray[np.float64]
    blocks: int
    independent_averages: float

    @property
    def drive_psd(self) -> NDArray[np.float64]:
        """Auto-spectrum of each drive, shape (lines, drives)."""
        return np.ascontiguousarray(np.einsum("fjj->fj", self.s_uu).real)


def estimate_h1(
    drive: ArrayLike,
    response: ArrayLike,
    *,
    block_samples: int,
    overlap: float,
    sample_rate: float,
    lowest: float,
    highest: float,
) -> FrfEstimate:
    """Estimate an FRF matrix by H1, ``S_yu S_uu^-1``, over overlapping Hann blocks.

    Parameters
    ----------
    drive
        Shape (drives, samples), without its mean.
    response
        Shape (responses, samples), without its mean: a static force leaks into the lowest two lines otherwise.
    block_samples
        Samples in a block, even, 2 or more.
    overlap
        Share of a block that its successor repeats, 0 up to but not including 1.
    sample_rate
        In hertz, greater than 0.
    lowest, highest
        Band in which it is estimated, in hertz: the band that was excited.

    Returns
    -------
    FrfEstimate
        0 outside the band, where ``S_uu`` is singular and H1 is noise.

    Raises
    ------
    ValueError
        Where the records do not agree, no line lies in the band, a response is silent at a line of the band, or
        ``S_uu`` is singular there.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eq. 1; Bendat & Piersol, *Random Data*, chapter 7.
    """
    inputs, outputs = as_record(drive, name="drive"), as_record(response, name="response")
    running = CrossSpectra(
        outputs.shape[0], inputs.shape[0], block_samples=block_samples, overlap=overlap, sample_rate=sample_rate
    )
    running.add(outputs, inputs)
    return h1_from_spectra(running.estimate(), lowest=lowest, highest=highest)


def h1_from_spectra(spectra: SpectraEstimate, *, lowest: float, highest: float) -> FrfEstimate:
    """Estimate an FRF matrix by H1 from averaged spectra, `a` the responses and `b` the drives.

    Parameters
    ----------
    spectra
        As `spectra.CrossSpectra` averaged them.
    lowest, highest
        Band in which it is estimated, in hertz.

    Returns
    -------
    FrfEstimate
        0 outside the band.

    Raises
    ------
    ValueError
        See `estimate_h1`.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eq. 1.
    """
    frequency, s_yu, s_uu = spectra.frequency, spectra.s_ab, spectra.s_bb
    band = np.flatnonzero((frequency >= lowest) & (frequency <= highest))
    if band.size == 0:
        raise ValueError(
            f"No line lies in the band from {lowest:g} to {highest:g} Hz; the lines are {frequency[1]:.4g} Hz apart, "
            "so take longer blocks or a wider band."
        )
    scale, coherence_of_drives = _unit_diagonal(s_uu[band], frequency[band])
    condition = _condition(coherence_of_drives, frequency[band])
    # H = S_yu S_uu^-1, with S_uu = D R D: solved with R, so that the drives' units do not matter.
    scaled = np.linalg.solve(
        coherence_of_drives.transpose(0, 2, 1), (s_yu[band] / scale[:, None, :]).transpose(0, 2, 1)
    )
    frf_in_band = scaled.transpose(0, 2, 1) / scale[:, None, :]

    s_yy = spectra.auto_a[band]
    silent = np.argwhere(s_yy == 0.0)
    if silent.size:
        line, channel = silent[0]
        raise ValueError(
            f"Response {channel} is silent at {frequency[band][line]:.4g} Hz, so nothing can be identified from it; "
            "check its sensor or leave it out."
        )
    explained = np.einsum("fij,fij->fi", frf_in_band, s_yu[band].conj()).real

    lines, n_y, n_u = s_yu.shape
    frf = np.zeros((lines, n_y, n_u), dtype=np.complex128)
    coherence, condition_number = np.zeros((lines, n_y)), np.zeros(lines)
    frf[band] = frf_in_band
    # It is in [0, 1] but for rounding, which must not send a coherence of 1.0000000000000002 over the bus.
    coherence[band] = np.clip(explained / s_yy, 0.0, 1.0)
    condition_number[band] = condition
    return FrfEstimate(
        frequency=frequency,
        frf=frf,
        coherence=coherence,
        condition_number=condition_number,
        s_uu=s_uu,
        response_psd=spectra.auto_a,
        blocks=spectra.blocks,
        independent_averages=spectra.independent_averages,
    )


def _unit_diagonal(
    s_uu: NDArray[np.complex128], frequency: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    power = np.einsum("fjj->fj", s_uu).real
    silent = np.argwhere(power <= 0.0)
    if silent.size:
        line, channel = silent[0]
        raise ValueError(
            f"Drive {channel} is silent at {frequency[line]:.4g} Hz, so S_uu is singular there; "
            "excite every drive in the whole band."
        )
    scale = np.sqrt(power)
    return scale, s_uu / (scale[:, :, None] * scale[:, None, :])


def _condition(coherence_of_drives: NDArray[np.complex128], frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Condition number per line; refuses singular drives, which the coherence does not reveal."""
    eigenvalues = np.linalg.eigvalsh(coherence_of_drives)
    positive = eigenvalues[:, 0] > 0.0
    condition = np.divide(eigenvalues[:, -1], eigenvalues[:, 0], out=np.full(frequency.shape, np.inf), where=positive)
    worst = int(np.argmax(condition))
    if condition[worst] > LARGEST_CONDITION:
        raise ValueError(
            f"The drives' cross-spectrum is singular at {frequency[worst]:.4g} Hz: its condition number is "
            f"{condition[worst]:.3g}, at most {LARGEST_CONDITION:g} is allowed; take drives that are independent of "
            "each other, and more blocks than drives."
        )
    return condition
