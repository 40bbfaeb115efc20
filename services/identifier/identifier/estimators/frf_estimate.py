"""Result of every estimator: an FRF matrix and its uncertainty."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from duralab_settings import EstimatorKind


class WarningCode(Enum):
    """Code of a warning about a record or an estimate."""

    CLIPPED = "clipped"
    """A channel stays at its largest or smallest value."""
    STUCK = "stuck"
    """A response keeps one value for long though drives move."""
    TRANSIENT = "transient"
    """Capture blocks are not yet periodic."""
    FEW_AVERAGES = "few_averages"
    """No more averages than drives, or hardly more equations than unknowns of a local method."""
    SMOOTHED = "smoothed"
    """A local method is biased: it differs from H1 of captures without a window, or from itself over fewer lines."""
    STATIC_GAIN = "static_gain"
    """A response had not settled when its static gain was measured, or this does not continue the FRF."""


@dataclass(frozen=True)
class ModelWarning:
    """One suspicion, as text and in figures.

    Parameters
    ----------
    code
        What kind.
    sentence
        For a person: channel, size, what to do.
    channel
        Row of the record, None where it concerns no single channel.
    of_drive
        Whether `channel` counts drives; responses otherwise.
    size
        Share between 0 and 1 (clipped, stuck: of the samples; transient, smoothed: of the channel's RMS), None where
        there is none.
    band
        Lowest and highest frequency concerned, in Hz; None where it concerns all.
    """

    code: WarningCode
    sentence: str
    channel: int | None = None
    of_drive: bool = False
    size: float | None = None
    band: tuple[float, float] | None = None


@dataclass(frozen=True)
class FrfEstimate:
    """An estimated FRF matrix with figures of its quality.

    At lines that are not valid nothing is estimated: FRF, coherence, condition number, residual, degrees of freedom and
    averages are 0 there. The covariance of row ``i`` is ``S_ee,i S_uu^-1 / averages`` at each valid line.

    Parameters
    ----------
    frequency
        Shape (lines), in hertz, from 0 to half the sample rate.
    frf
        Complex, shape (lines, responses, drives), with ``e^{+j omega t}``.
    coherence
        Multiple coherence, shape (lines, responses), 0 to 1. Of averaged spectra it holds the share of the noise that
        so few averages let the drives explain; of a local method it does not.
    condition_number
        Of ``S_uu`` scaled to unit diagonal, shape (lines), 1 or more at valid lines.
    s_uu
        Complex, shape (lines, drives, drives), one-sided density.
    response_psd
        Shape (lines, responses), one-sided density.
    blocks
        Blocks averaged (Eq. 10).
    independent_averages
        Equivalent independent blocks (Welch's formula); of periodic drives, captures.
    valid
        Shape (lines): where it is estimated, the excited lines of the band.
    residual_psd
        Shape (lines, responses): ``S_ee``, what the drives do not explain, without the bias of the fit; 0 where no
        degree of freedom is left to know it.
    degrees_of_freedom
        Shape (lines): complex degrees of freedom of the residual, 0 where there are none.
    averages
        Shape (lines): equivalent averages behind the FRF at each line, see the covariance above.
    kind
        The estimator.
    half_width
        Shape (lines): lines to either side that a local method fitted; 0 where it took H1. None of other estimators.
    warnings
        What is suspicious.
    """

    frequency: NDArray[np.float64]
    frf: NDArray[np.complex128]
    coherence: NDArray[np.float64]
    condition_number: NDArray[np.float64]
    s_uu: NDArray[np.complex128]
    response_psd: NDArray[np.float64]
    blocks: int
    independent_averages: float
    valid: NDArray[np.bool_]
    residual_psd: NDArray[np.float64]
    degrees_of_freedom: NDArray[np.float64]
    averages: NDArray[np.float64]
    kind: EstimatorKind = EstimatorKind.H1
    half_width: NDArray[np.int64] | None = None
    warnings: tuple[ModelWarning, ...] = field(default=())

    @property
    def drive_psd(self) -> NDArray[np.float64]:
        """Auto-spectrum of each drive, shape (lines, drives)."""
        return np.ascontiguousarray(np.einsum("fjj->fj", self.s_uu).real)

    @property
    def unexplained_psd(self) -> NDArray[np.float64]:
        """Residual spectrum of each response, not explained by the drives, shape (lines, responses).

        Without the bias of the fit, by which it may pass `response_psd` by chance; 0 where no degree of freedom is
        left. Of H1 it is `residual_psd`; that of H2 and Hv holds what these estimators add, too.
        """
        unexplained = self.response_psd * (1.0 - self.coherence)
        held = self.degrees_of_freedom > 0.0
        if not self.kind.is_local:
            # The drives explain their share of any noise. A local method's coherence is free of that already.
            share = np.divide(self.averages, self.degrees_of_freedom, out=np.zeros_like(self.averages), where=held)
            unexplained *= share[:, None]
        return np.where((self.valid & held)[:, None], unexplained, 0.0)
