"""Answers of an identification besides the model: plan, predicted convergence, levels, differences."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np

from duralab.data.model import FREQUENCY_AXIS, Model
from duralab.display import Axis, Curve, line_chart, text_table


@dataclass(frozen=True)
class ExperimentPlan:
    """Plan of an experiment; see `duralab.v1.ExperimentPlan`.

    Parameters
    ----------
    duration_seconds : float
        Length of the whole drive, in seconds.
    realisations, experiments_per_realisation, periods : int
        Independent phases, columns of the orthogonal matrix played of each, and periods kept of each experiment; 1, the
        number of uninterrupted stretches and 0 where the excitation is not periodic.
    delay_share : float
        Share of the duration that is dropped while transients die out, fades included, 0 to 1.
    independent_averages : float
        Equivalent independent blocks averaged.
    frequency_resolution : float
        Distance of neighbouring lines, in hertz.
    lines : int
        Lines at which the rig is excited.
    band : tuple of float
        In which the model would be valid, in hertz.
    """

    duration_seconds: float
    realisations: int
    experiments_per_realisation: int
    periods: int
    delay_share: float
    independent_averages: float
    frequency_resolution: float
    lines: int
    band: tuple[float, float]

    def __str__(self) -> str:
        """Return it as a table."""
        return plan_text(self)


@dataclass(frozen=True, eq=False)
class Convergence:
    """Predicted convergence of an iteration with the inverse of a model; see `duralab.v1.Convergence`.

    Parameters
    ----------
    frequency : np.ndarray, shape (lines)
        Lines of the band, in hertz.
    spectral_radius : np.ndarray, shape (lines)
        Of the error's dynamics (Eq. 6) for the likeliest rig; below 1 it converges.
    spectral_radius_95 : np.ndarray, shape (lines)
        That 95 % of the rigs which the model's uncertainty allows stay below.
    largest_singular_value : np.ndarray, shape (lines)
        Responses scaled to the model's response PSD; below 1 the error falls at every playback.
    converging_share : float
        Share of those rigs that converge at every line, 0 to 1.
    sentence : str
        Summary as text.
    """

    frequency: np.ndarray
    spectral_radius: np.ndarray
    spectral_radius_95: np.ndarray
    largest_singular_value: np.ndarray
    converging_share: float
    sentence: str

    def __repr__(self) -> str:
        """Return it on one line, without arrays."""
        return f"Convergence({self.sentence})"

    def __str__(self) -> str:
        """Return the sentence."""
        return self.sentence

    def _repr_html_(self) -> str:

        return convergence_html(self)


@dataclass(frozen=True, eq=False)
class LevelAdvice:
    """Drive levels that give responses like the target's; see `duralab.v1.LevelAdvice`.

    Parameters
    ----------
    rms : np.ndarray, shape (drives)
        Proposed for each drive, in its unit.
    wanted_rms : np.ndarray, shape (drives)
        That would give responses like the target's, regardless of the limits.
    largest_rms : np.ndarray, shape (drives)
        At which the crest factor just reaches the drive's limit.
    identification_damage : np.ndarray or None, shape (responses, 3)
        Damage that the model's own experiment would do at the proposed levels, in passes of the target, for S-N lines
        of slope 3, 5 and 8; None where the model does not state its own.
    one_pass_factor : float
        Factor on all levels of the model's own experiment at which it would do no more damage than one pass of the
        target in any response, slope 5; 0 where the model does not state its damage.
    sentences : tuple of str
        One for each drive, and one on the damage.
    """

    rms: np.ndarray
    wanted_rms: np.ndarray
    largest_rms: np.ndarray
    identification_damage: np.ndarray | None
    one_pass_factor: float
    sentences: tuple[str, ...]

    def __str__(self) -> str:
        """Return it as a table."""
        return advice_text(self)


@dataclass(frozen=True, eq=False)
class ModelDifference:
    """Difference of a model from the one before it; see `duralab.v1.ModelDifference`.

    Parameters
    ----------
    relative_difference : np.ndarray, shape (lines, responses)
        Difference of both FRF matrices over the first, drives weighted by their PSD; 0 outside the band.
    expected_by_noise : np.ndarray, shape (lines, responses)
        What the random errors of both models alone would make of it.
    sentences : tuple of str
        One for each response.
    """

    relative_difference: np.ndarray
    expected_by_noise: np.ndarray
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class LevelSeries:
    """Models of one rig from the lowest level to the highest, and the difference of each to the one before.

    Parameters
    ----------
    models : tuple of Model
        One for each level.
    differences : tuple of ModelDifference
        One less.
    """

    models: tuple[Model, ...]
    differences: tuple[ModelDifference, ...]


def plan_text(plan: ExperimentPlan) -> str:
    """Return what an experiment takes and gives as text."""
    low, high = plan.band
    rows = (
        ("duration", f"{plan.duration_seconds:.1f} s"),
        ("realisations", str(plan.realisations)),
        ("experiments per realisation", str(plan.experiments_per_realisation)),
        ("periods", str(plan.periods)),
        ("share of delays", f"{plan.delay_share:.0%}"),
        ("independent averages", f"{plan.independent_averages:.1f}"),
        ("band", f"{low:.3g} to {high:.3g} Hz, {plan.lines} lines, one every {plan.frequency_resolution:.3g} Hz"),
    )
    return text_table(("experiment", ""), rows, left=2)


def advice_text(advice: LevelAdvice) -> str:
    """Return advised, wanted and largest RMS of each drive, and why, as text."""
    rows = [
        (str(number), *(f"{value:.3g}" for value in values))
        for number, values in enumerate(zip(advice.rms, advice.wanted_rms, advice.largest_rms, strict=True), start=1)
    ]
    table = text_table(("drive", "advised RMS", "wanted", "largest"), rows)
    return "\n".join((table, *(f"- {sentence}" for sentence in advice.sentences)))


def convergence_html(convergence: Convergence) -> str:
    """Return the spectral radius over frequency as a picture, below 1 it converges, and the sentence."""
    frequency = convergence.frequency
    curves = [
        Curve("expected", frequency, convergence.spectral_radius),
        Curve("95 % of the rigs are below", frequency, convergence.spectral_radius_95),
        Curve("1", frequency, np.ones_like(frequency)),
    ]
    chart = line_chart(curves, x=FREQUENCY_AXIS, y=Axis("spectral radius"), from_zero=True)
    return f"<p>{escape(convergence.sentence)}</p>{chart}"
