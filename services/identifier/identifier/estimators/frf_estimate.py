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
    """A response keeps one value for a long time though drives move."""
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
    """One finding, as text and in figures.

    Parameters
    ----------
    code
        Kind of the warning.
    sentence
        Sentence for a person: channel, size, remedy.
    channel
        Row of the record; None if it does not concern a single channel.
    of_drive
        Whether `channel` counts drives; responses otherwise.
    size
        Share between 0 and 1 (clipped, stuck: of the samples; transient, smoothed: of the channel's RMS); None if there
        is no share.
    band
        Lowest and highest frequency concerned, in Hz; None if it concerns all.
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

    There is no estimate at lines that are not valid: FRF, coherence, condition number, residual, degrees of freedom and
    averages are 0 there. The covariance of row ``i`` is ``S_ee,i S_uu^-1 / averages`` at each valid line.

    Parameters
    ----------
    frequency
        Shape (lines), in hertz, from 0 to half the sample rate.
    frf
        Complex, shape (lines, responses, drives), with ``e^{+j omega t}``.
    coherence
        Multiple coherence, shape (lines, responses), 0 to 1. From averaged spectra it includes the share of the noise
        that the drives explain because of few averages; from a local method it does not.
    condition_number
        Condition number of ``S_uu`` scaled to unit diagonal, shape (lines), 1 or more at valid lines.
    s_uu
        Complex, shape (lines, drives, drives), one-sided density.
    response_psd
        Shape (lines, responses), one-sided density.
    blocks
        Number of averaged blocks (Eq. 10).
    independent_averages
        Equivalent independent blocks (Welch's formula); for periodic drives, captures.
    valid
        Shape (lines): estimated lines, which are the excited lines of the band.
    residual_psd
        Shape (lines, responses): ``S_ee``, the part that the drives do not explain, without the bias of the fit; 0 if
        no degree of freedom is left for it.
    degrees_of_freedom
        Shape (lines): complex degrees of freedom of the residual, 0 if there are none.
    averages
        Shape (lines): equivalent averages of the FRF at each line, see the covariance above.
    kind
        Estimator.
    half_width
        Shape (lines): lines to either side of a local fit; 0 where it used H1. None for other estimators.
    warnings
        Warnings about the record.
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

        Without the bias of the fit, so it may exceed `response_psd` by chance; 0 if no degree of freedom is left. For
        H1 it is `residual_psd`; for H2 and Hv it also includes what these estimators add.
        """
        unexplained = self.response_psd * (1.0 - self.coherence)
        held = self.degrees_of_freedom > 0.0
        if not self.kind.is_local:
            # The drives explain their share of any noise. A local method's coherence excludes that already.
            share = np.divide(self.averages, self.degrees_of_freedom, out=np.zeros_like(self.averages), where=held)
            unexplained *= share[:, None]
        return np.where((self.valid & held)[:, None], unexplained, 0.0)
