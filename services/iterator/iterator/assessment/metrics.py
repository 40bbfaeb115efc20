"""Errors of one playback against the target, in the control band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_loads import DAMAGE_EXPONENTS, channel_damage, damage_ratio
from duralab_spectra import crest_factor, overall_relative_rms_error, peak_ratio, relative_rms_error, rms_response


@dataclass(frozen=True)
class IterationMetrics:
    """Figures of one playback; arrays have one value for each response.

    Parameters
    ----------
    relative_rms_error : ndarray, shape (n_y,)
        `rms(y_d - y) / rms(y_d)`; ideal is 0.
    rms_response : ndarray, shape (n_y,)
        `rms(y) / rms(y_d)`; ideal is 1.
    peak_ratio : ndarray, shape (n_y,)
        Largest magnitude of the response over that of the target; ideal is 1.
    overall_relative_rms_error : float
        Root mean square of `relative_rms_error` over the controlled responses.
    crest_ratio : ndarray, shape (n_y,)
        Crest factor of the response over that of the target; ideal is 1; 0 for a response at rest.
    damage_ratio : ndarray, shape (n_y, exponents)
        Pseudo-damage of the response over that of the target for the slopes `DAMAGE_EXPONENTS`; ideal is 1.
    specimen_damage : ndarray, shape (n_y, exponents)
        Damage spent by this playback, in passes of the target: pseudo-damage of the response as measured, regardless of
        the control band and the level, over that of the target as measured. The target at its level counts at least: a
        dead sensor does not mean an unharmed specimen.
    controlled : ndarray of bool, shape (n_y,), optional
        False for a monitored response, which is not used for any judgement. If not given, all are controlled.
    identification_damage : ndarray, shape (n_y, exponents), optional
        Damage spent by the identification, counted as `specimen_damage`; the same in every playback. NaN for a
        monitored response with a silent target; None if it is not known.
    """

    relative_rms_error: NDArray[np.float64]
    rms_response: NDArray[np.float64]
    peak_ratio: NDArray[np.float64]
    overall_relative_rms_error: float
    crest_ratio: NDArray[np.float64]
    damage_ratio: NDArray[np.float64]
    specimen_damage: NDArray[np.float64]
    controlled: NDArray[np.bool_] | None = None
    identification_damage: NDArray[np.float64] | None = None

    @property
    def correlation(self) -> NDArray[np.float64]:
        """Correlation of each response with its target, -1 to 1, shape (n_y,), by the law of cosines; 0 at rest."""
        r, e = self.rms_response, self.relative_rms_error
        return np.divide(1.0 + r**2 - e**2, 2.0 * r, out=np.zeros_like(r), where=r != 0.0)

    def judged(self, figures: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rows of the figures, one for each response, by which a playback is judged."""
        return figures if self.controlled is None else figures[self.controlled]


def judge_response(
    target: NDArray[np.float64],
    response: NDArray[np.float64],
    *,
    level: float = 1.0,
    controlled: NDArray[np.bool_] | None = None,
    measured: NDArray[np.float64] | None = None,
    target_damage: NDArray[np.float64] | None = None,
) -> IterationMetrics:
    """Compare a response with the target.

    Parameters
    ----------
    target, response : ndarray, shape (n_y, samples)
        Both in the control band, response units; no controlled channel of the target zero throughout.
    level : float
        Share of the target that was played and by which the response was divided, above 0 to 1.
    controlled : ndarray of bool, shape (n_y,), optional
        False for a monitored response; if not given, all are controlled.
    measured : ndarray, shape (n_y, samples), optional
        Response as measured, neither limited to the control band nor divided by the level, from which the
        specimen's damage is counted. If not given: `level` times `response`.
    target_damage : ndarray, shape (n_y, exponents), optional
        Pseudo-damage of the target as measured, for the slopes `DAMAGE_EXPONENTS`; that of `target` if not given.

    Returns
    -------
    IterationMetrics
        Figures of this playback. The figures of a monitored response with a silent target are NaN: there is nothing
        that they could be relative to.

    Raises
    ------
    ValueError
        Shapes that differ, values that are not finite, or a silent target of a controlled response.
    """
    if controlled is not None and not controlled.all():
        return _judge_with_watched(
            target, response, level=level, controlled=controlled, measured=measured, target_damage=target_damage
        )
    damage = damage_ratio(target, response)
    least = level ** np.asarray(DAMAGE_EXPONENTS)
    if measured is None:
        spent = damage * least
    elif target_damage is None:
        spent = damage_ratio(target, measured)
    else:
        spent = channel_damage(measured) / target_damage
    moves = np.any(response != 0.0, axis=1)
    crest = np.zeros(target.shape[0])
    crest[moves] = crest_factor(response[moves]) / crest_factor(target[moves]) if moves.any() else 0.0
    return IterationMetrics(
        relative_rms_error=relative_rms_error(target, response),
        rms_response=rms_response(target, response),
        peak_ratio=peak_ratio(target, response),
        overall_relative_rms_error=overall_relative_rms_error(target, response),
        crest_ratio=crest,
        damage_ratio=damage,
        # A dead sensor does not mean an unharmed specimen: count at least the damage of the target at its level.
        specimen_damage=np.maximum(least, spent),
    )


def _judge_with_watched(
    target: NDArray[np.float64],
    response: NDArray[np.float64],
    *,
    level: float,
    controlled: NDArray[np.bool_],
    measured: NDArray[np.float64] | None,
    target_damage: NDArray[np.float64] | None,
) -> IterationMetrics:
    # A silent target of a controlled response is kept, so that `judge_response` refuses it.
    judged = controlled | np.any(target != 0.0, axis=1)
    found = judge_response(
        target[judged],
        response[judged],
        level=level,
        measured=None if measured is None else measured[judged],
        target_damage=None if target_damage is None else target_damage[judged],
    )

    def of_all(figures: NDArray[np.float64]) -> NDArray[np.float64]:
        result = np.full((judged.size, *figures.shape[1:]), np.nan)
        result[judged] = figures
        return result

    return IterationMetrics(
        relative_rms_error=of_all(found.relative_rms_error),
        rms_response=of_all(found.rms_response),
        peak_ratio=of_all(found.peak_ratio),
        overall_relative_rms_error=overall_relative_rms_error(target[controlled], response[controlled]),
        crest_ratio=of_all(found.crest_ratio),
        damage_ratio=of_all(found.damage_ratio),
        specimen_damage=of_all(found.specimen_damage),
        controlled=controlled,
    )


def best_iteration(metrics: tuple[IterationMetrics, ...]) -> int:
    """Return the number of the playback with the smallest error over all channels.

    Parameters
    ----------
    metrics : tuple of IterationMetrics
        Figures from the first playback to the last.

    Returns
    -------
    int
        Number from 1; 0 if there is no playback.
    """
    if not metrics:
        return 0
    return 1 + int(np.argmin([figures.overall_relative_rms_error for figures in metrics]))
