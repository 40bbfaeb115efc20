"""Results of an identification other than the model: plan, predicted convergence, levels, differences."""

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
        Numbers of independent phases, of columns of the orthogonal matrix played for each, and of periods kept of each
        experiment; for an excitation that is not periodic: 1, the number of uninterrupted segments, and 0.
    delay_share : float
        Share of the duration dropped while transients decay, fades included, 0 to 1.
    independent_averages : float
        Equivalent number of independent averaged blocks.
    frequency_resolution : float
        Distance of neighbouring lines, in hertz.
    lines : int
        Number of excited frequency lines.
    band : tuple of float
        Band in which the model will be valid, in hertz.
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
        """Return a table as text."""
        return plan_text(self)


@dataclass(frozen=True, eq=False)
class Convergence:
    """Predicted convergence of an iteration with the inverse of a model; see `duralab.v1.Convergence`.

    Parameters
    ----------
    frequency : np.ndarray, shape (lines)
        Lines of the band, in hertz.
    spectral_radius : np.ndarray, shape (lines)
        Spectral radius of the error's dynamics (Eq. 6) for the most likely rig; below 1 the iteration converges.
    spectral_radius_95 : np.ndarray, shape (lines)
        Spectral radius not exceeded by 95 % of the rigs within the model's uncertainty.
    largest_singular_value : np.ndarray, shape (lines)
        Largest singular value, with responses scaled to the model's response PSD; below 1 the error decreases at every
        playback.
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
        """Return a one-line description without arrays."""
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
        Proposed RMS of each drive, in its unit.
    wanted_rms : np.ndarray, shape (drives)
        RMS that would give responses at the target's level, regardless of the limits.
    largest_rms : np.ndarray, shape (drives)
        RMS at which the drive's peaks reach its limit.
    identification_damage : np.ndarray or None, shape (responses, 3)
        Damage of the model's experiment at the proposed levels, in passes of the target, for S-N lines of slope 3, 5
        and 8; None if the model does not state its damage.
    one_pass_factor : float
        Factor on all levels of the model's experiment at which its damage is at most that of one pass of the target
        in any response, slope 5; 0 if the model does not state its damage.
    sentences : tuple of str
        Sentences, one for each drive and one on the damage.
    """

    rms: np.ndarray
    wanted_rms: np.ndarray
    largest_rms: np.ndarray
    identification_damage: np.ndarray | None
    one_pass_factor: float
    sentences: tuple[str, ...]

    def __str__(self) -> str:
        """Return a table as text."""
        return advice_text(self)


@dataclass(frozen=True, eq=False)
class ModelDifference:
    """Difference of a model from the one before it; see `duralab.v1.ModelDifference`.

    Parameters
    ----------
    relative_difference : np.ndarray, shape (lines, responses)
        Difference of both FRF matrices relative to the first, drives weighted by their PSD; 0 outside the band.
    expected_by_noise : np.ndarray, shape (lines, responses)
        Difference expected from the random errors of both models alone.
    sentences : tuple of str
        Sentences, one for each response.
    """

    relative_difference: np.ndarray
    expected_by_noise: np.ndarray
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class LevelSeries:
    """Models of one rig from the lowest level to the highest, and the difference of each to the previous one.

    Parameters
    ----------
    models : tuple of Model
        Models, one for each level.
    differences : tuple of ModelDifference
        Differences, one less than models.
    """

    models: tuple[Model, ...]
    differences: tuple[ModelDifference, ...]


def plan_text(plan: ExperimentPlan) -> str:
    """Return the plan of an experiment as text."""
    low, high = plan.band
    rows = (
        ("duration", f"{plan.duration_seconds:.1f} s"),
        ("realisations", str(plan.realisations)),
        ("experiments per realisation", str(plan.experiments_per_realisation)),
        ("periods", str(plan.periods)),
        ("share of delays", f"{100 * plan.delay_share:.0f} %"),
        ("independent averages", f"{plan.independent_averages:.1f}"),
        ("band", f"{low:.3g} to {high:.3g} Hz, {plan.lines} lines, one every {plan.frequency_resolution:.3g} Hz"),
    )
    return text_table(("experiment", ""), rows, left=2)


def advice_text(advice: LevelAdvice) -> str:
    """Return advised, wanted and largest RMS of each drive, and the reasons, as text."""
    rows = [
        (str(number), *(f"{value:.3g}" for value in values))
        for number, values in enumerate(zip(advice.rms, advice.wanted_rms, advice.largest_rms, strict=True), start=1)
    ]
    table = text_table(("drive", "advised RMS", "wanted", "largest"), rows)
    return "\n".join((table, *(f"- {sentence}" for sentence in advice.sentences)))


def convergence_html(convergence: Convergence) -> str:
    """Return the sentence and a chart of the spectral radius over frequency; below 1 the iteration converges."""
    frequency = convergence.frequency
    curves = [
        Curve("expected", frequency, convergence.spectral_radius),
        Curve("95 % of the rigs are below", frequency, convergence.spectral_radius_95),
        Curve("1", frequency, np.ones_like(frequency)),
    ]
    chart = line_chart(curves, x=FREQUENCY_AXIS, y=Axis("spectral radius"), from_zero=True)
    return f"<p>{escape(convergence.sentence)}</p>{chart}"
