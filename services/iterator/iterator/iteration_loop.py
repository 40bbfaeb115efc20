"""The iteration itself: update, play, judge, until a stop criterion says so; any Python function can be the rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from iterator import adaptive_modelling, basic_twr
from iterator.drive_limits import DriveLimits, require_within_limits
from iterator.drive_update import Update, UpdateKind, UpdateSettings
from iterator.iteration_history import IterationHistory, Playback
from iterator.iteration_metrics import IterationMetrics, best_iteration, judge_response
from iterator.rig_model import RigModel
from iterator.stop_criteria import Outcome, StopCriteria, judge_end
from spectra import as_record

Play = Callable[[NDArray[np.float64]], ArrayLike]
"""Plays a drive, shape (n_u, samples), and returns the measured response, shape (n_y, samples)."""

UPDATES: Final[Mapping[UpdateKind, Update]] = MappingProxyType(
    {
        UpdateKind.BASIC_TWR: basic_twr.next_drive,
        UpdateKind.ADAPTIVE_MODELLING: adaptive_modelling.next_drive,
    }
)
"""The update of each kind."""


@dataclass(frozen=True)
class CampaignSettings:
    """How to iterate and when to end.

    Parameters
    ----------
    update : UpdateSettings
        Kind, control band, gains and safeguards.
    stop : StopCriteria
        When to end.
    """

    update: UpdateSettings
    stop: StopCriteria


@dataclass(frozen=True)
class Iteration:
    """One playback and what was made of it.

    Parameters
    ----------
    number : int
        From 1.
    drive : ndarray, shape (n_u, samples)
        As played.
    response : ndarray, shape (n_y, samples)
        As measured.
    response_in_band : ndarray, shape (n_y, samples)
        As judged.
    metrics : IterationMetrics
        In the control band.
    model : RigModel
        What the drive was made with.
    outcome : Outcome or None
        Why this is the last one; None where it goes on.
    """

    number: int
    drive: NDArray[np.float64]
    response: NDArray[np.float64]
    response_in_band: NDArray[np.float64]
    metrics: IterationMetrics
    model: RigModel
    outcome: Outcome | None


@dataclass(frozen=True)
class CampaignResult:
    """Everything that an iteration made.

    Parameters
    ----------
    target_in_band : ndarray, shape (n_y, samples)
        What the responses were judged against.
    iterations : tuple of Iteration
        From the first to the last.
    outcome : Outcome
        Why it ended.
    best_iteration : int
        Number of the playback with the smallest error over all channels, from 1.
    """

    target_in_band: NDArray[np.float64]
    iterations: tuple[Iteration, ...]
    outcome: Outcome
    best_iteration: int


def iterate(
    play: Play,
    target_in_band: ArrayLike,
    *,
    model: RigModel,
    settings: CampaignSettings,
    limits: DriveLimits | None = None,
) -> Iterator[Iteration]:
    """Iterate from `U_0 = 0`, one playback for each value yielded.

    The next drive is made only when the next value is asked for, so that a caller can store one step before the next.

    Parameters
    ----------
    play : callable
        The rig.
    target_in_band : array_like, shape (n_y, samples)
        From `ControlBand.limit_target`, any length.
    model : RigModel
        As identified.
    settings : CampaignSettings
        How and how long.
    limits : DriveLimits, optional
        Of the rig; not checked where not given.

    Yields
    ------
    Iteration
        After each playback; the last one carries the outcome.

    Raises
    ------
    DriveLimitError
        A next drive would pass a limit; it is not played.
    ValueError
        The response played back is not as long as the drive, not finite or of other channels, or the update refuses.
    """
    history = IterationHistory(target=as_record(target_in_band, name="target"))
    update = UPDATES[settings.update.kind]
    metrics: tuple[IterationMetrics, ...] = ()
    outcome = None
    while outcome is None:
        step = update(history, model, settings.update)
        model = step.model
        if limits is not None:
            require_within_limits(
                step.drive,
                last_drive=history.playbacks[-1].drive if history.playbacks else None,
                limits=limits,
                iteration_gain=settings.update.iteration_gain,
            )
        response = as_record(play(step.drive), name="response")
        response_in_band = settings.update.band.limit_response(response)
        metrics = (*metrics, judge_response(history.target, response_in_band))
        outcome = judge_end(metrics, settings.stop)
        history = history.after(Playback(drive=step.drive, response=response_in_band))
        yield Iteration(
            number=len(metrics),
            drive=step.drive,
            response=response,
            response_in_band=response_in_band,
            metrics=metrics[-1],
            model=model,
            outcome=outcome,
        )


def run_campaign(
    play: Play,
    target: ArrayLike,
    *,
    model: RigModel,
    settings: CampaignSettings,
    limits: DriveLimits | None = None,
) -> CampaignResult:
    """Iterate to the end; see `iterate`.

    Parameters
    ----------
    play : callable
        The rig.
    target : array_like, shape (n_y, samples)
        As measured; its dynamic part in the control band is reproduced.
    model : RigModel
        As identified.
    settings : CampaignSettings
        How and how long.
    limits : DriveLimits, optional
        Of the rig.

    Returns
    -------
    CampaignResult
        All playbacks, why it ended and which was best.

    Raises
    ------
    DriveLimitError, ValueError
        As `iterate` does.
    """
    target_in_band = settings.update.band.limit_target(as_record(target, name="target"))
    iterations = tuple(iterate(play, target_in_band, model=model, settings=settings, limits=limits))
    outcome = iterations[-1].outcome
    if outcome is None:
        raise AssertionError("The last iteration carries the outcome.")
    return CampaignResult(
        target_in_band=target_in_band,
        iterations=iterations,
        outcome=outcome,
        best_iteration=best_iteration(tuple(iteration.metrics for iteration in iterations)),
    )
