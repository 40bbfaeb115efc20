"""Model errors on the drives' side and on the responses' side: which correction of Adaptive Modelling repairs which.

`python studies/input_side_errors.py` writes picture and tables of docs/studies/input_side_errors.md again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from low_level_campaigns import BAND, IDENTIFIED, identified, predecessor_target
from low_level_comparison import ONE
from matplotlib.axes import Axes
from numpy.typing import NDArray
from study_page import Findings, label, markdown_table, percent, plain_numbers, plt, run

from duralab_settings import CorrectionPrediction, CorrectionShape, StopCriteria, UpdateKind
from duralab_spectra import rms
from iterator import (
    NO_BOUNDS,
    CampaignSettings,
    RigModel,
    UpdateSettings,
    iterate,
    predict,
    rig_model,
)

Matrices = NDArray[np.complex128]


@dataclass(frozen=True)
class Mistake:
    """An error of the model as a matrix at each line, which multiplies the FRF from the drives' or responses' side."""

    name: str
    matrix: Callable[[NDArray[np.float64]], Matrices]


@dataclass(frozen=True)
class Algorithm:
    """A line of the picture and a column of the table."""

    name: str
    colour: str
    style: str
    settings: UpdateSettings


@dataclass(frozen=True)
class Extent:
    """Extent of the study: seconds of road, potholes, playbacks."""

    seconds: float
    potholes: int
    playbacks: int


FULL: Final = Extent(16.0, 2, 7)
QUICK: Final = Extent(6.0, 1, 2)
SEED: Final = 1
#: Share of the target's RMS.
NOISE: Final = 0.003
_GAIN: Final = 0.8 * ONE
_SIZE: Final = ONE.size
#: The left wheel's lateral and longitudinal channel.
_LATERAL, _LONGITUDINAL = 1, 2
_TOO_STRONG, _DELAY_SECONDS, _ANGLE = 1.4, 0.006, math.radians(30.0)
#: Error above which the iteration counts as diverged.
_DIVERGED: Final = 2.0


def _constant(matrix: NDArray[np.float64]) -> Callable[[NDArray[np.float64]], Matrices]:
    return lambda frequency: np.broadcast_to(matrix.astype(np.complex128), (frequency.size, *matrix.shape))


def _turned() -> NDArray[np.float64]:
    matrix = np.eye(_SIZE)
    pair = np.ix_((_LATERAL, _LONGITUDINAL), (_LATERAL, _LONGITUDINAL))
    matrix[pair] = [[math.cos(_ANGLE), -math.sin(_ANGLE)], [math.sin(_ANGLE), math.cos(_ANGLE)]]
    return matrix


def _swapped() -> NDArray[np.float64]:
    return np.eye(_SIZE)[[0, 2, 1, 3, 4, 5]]


def _delayed(frequency: NDArray[np.float64]) -> Matrices:
    return np.exp(-2j * np.pi * frequency * _DELAY_SECONDS)[:, None, None] * np.diag([0, 1, 0, 0, 0, 0]) + np.diag(
        [1.0, 0, 1, 1, 1, 1]
    )


MISTAKES: Final = (
    Mistake("gain of one channel 1.4 times", _constant(np.diag([1.0, _TOO_STRONG, 1.0, 1.0, 1.0, 1.0]))),
    Mistake("one channel 6 ms late", _delayed),
    Mistake("lateral and longitudinal turned by 30°", _constant(_turned())),
    Mistake("lateral and longitudinal swapped", _constant(_swapped())),
)


def _adaptive(prediction: CorrectionPrediction, shape: CorrectionShape) -> UpdateSettings:
    return UpdateSettings(
        band=BAND, iteration_gain=_GAIN, kind=UpdateKind.ADAPTIVE_MODELLING, prediction=prediction, correction=shape
    )


_FORWARD, _BACKWARD = CorrectionPrediction.FORWARD, CorrectionPrediction.BACKWARD
_DIAGONAL, _FULL = CorrectionShape.DIAGONAL, CorrectionShape.FULL
ALGORITHMS: Final = (
    Algorithm("basic TWR", "#c0562a", "o-", UpdateSettings(band=BAND, iteration_gain=_GAIN, kind=UpdateKind.BASIC_TWR)),
    Algorithm("forward, diagonal (the paper)", "#3d8b4f", "o-", _adaptive(_FORWARD, _DIAGONAL)),
    Algorithm("forward, full", "#3d8b4f", "s--", _adaptive(_FORWARD, _FULL)),
    Algorithm("backward, diagonal", "#8c6bb1", "o-", _adaptive(_BACKWARD, _DIAGONAL)),
    Algorithm("backward, full", "#8c6bb1", "s--", _adaptive(_BACKWARD, _FULL)),
    Algorithm(
        "secant update",
        "#1b5e9b",
        "o-",
        UpdateSettings(band=BAND, iteration_gain=_GAIN, kind=UpdateKind.SECANT, accept_segments=True),
    ),
)


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    rig, target = identified(1.0, SEED), predecessor_target(extent.seconds, potholes=extent.potholes)
    figure, panels = plt.subplots(2, len(MISTAKES), figsize=(13.5, 7.0), layout="constrained", sharex=True, sharey=True)
    rows, foreseen = [], []
    for on_drives, place in ((True, panels[0]), (False, panels[1])):
        for mistake, axes in zip(MISTAKES, place, strict=True):
            side = "drives" if on_drives else "responses"
            model = mistaken(rig, mistake, on_drives=on_drives)
            errors = [errors_of(rig, model, target, algorithm, extent) for algorithm in ALGORITHMS]
            draw(axes, f"{side}: {mistake.name}", errors)
            name = f"{side}: {mistake.name}"
            rows.append([name, *(_told(error[-1]) for error in errors)])
            foreseen.append([name, *told_of_theory(rig, model, target)])
    rows.append(["nowhere", *(_told(errors_of(rig, rig, target, algorithm, extent)[-1]) for algorithm in ALGORITHMS)])
    for axes in panels[:, 0]:
        axes.set_ylabel("relative RMS error, all channels, %")
    for axes in panels[-1]:
        axes.set_xlabel("playback")
    plain_numbers(*panels.flat)
    panels[0, 0].set_ylim(0.4, 100.0 * _DIVERGED)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    after = f"error after {extent.playbacks}; the model is wrong at"
    theory = ["the ideal correction C of Eq. 15", "share off the diagonal, forward", "share off the diagonal, backward"]
    theory.append("largest spectral radius of Eq. 6")
    tables = (
        markdown_table([after, *(algorithm.name for algorithm in ALGORITHMS)], rows),
        markdown_table(theory, foreseen),
    )
    return Findings(figure, "\n\n".join(tables))


def mistaken(rig: RigModel, mistake: Mistake, *, on_drives: bool) -> RigModel:
    """Return the model with the mistake, channels counting by what they are used for: a row of 1 is a usual drive."""
    found = slice(rig.identified.start, rig.identified.stop)
    size = _drive_size(rig) if on_drives else _response_size(rig)
    matrix = mistake.matrix(rig.frequency[found]) * size[:, None] / size
    wrong = rig.frf.copy()
    wrong[found] = rig.frf[found] @ matrix if on_drives else matrix @ rig.frf[found]
    return rig_model(rig.frequency, wrong, identified_band=IDENTIFIED, uncertainty=rig.uncertainty)


def _drive_size(rig: RigModel) -> NDArray[np.float64]:
    return 1.0 / np.sqrt(np.mean(np.sum(np.abs(rig.frf[rig.identified]) ** 2, axis=1), axis=0))


def _response_size(rig: RigModel) -> NDArray[np.float64]:
    scaled = rig.frf[rig.identified] * _drive_size(rig)
    return np.sqrt(np.mean(np.sum(np.abs(scaled) ** 2, axis=2), axis=0))


def errors_of(
    rig: RigModel, model: RigModel, target: NDArray[np.float64], algorithm: Algorithm, extent: Extent
) -> NDArray[np.float64]:
    """Iterate on the linear rig with sensors' noise and return the error over all channels, shape (playbacks,)."""
    rng = np.random.default_rng(SEED)
    noise = NOISE * rms(target)[:, None]
    steps = iterate(
        lambda drive: predict(rig, drive, band=BAND) + noise * rng.standard_normal(target.shape),
        target,
        model=model,
        settings=CampaignSettings(
            update=algorithm.settings, stop=StopCriteria(iterations=extent.playbacks, **NO_BOUNDS)
        ),
    )
    return np.array([step.metrics.overall_relative_rms_error for step in steps])


def told_of_theory(rig: RigModel, model: RigModel, target: NDArray[np.float64]) -> list[str]:
    """Say what of the ideal corrections a diagonal one cannot hold, and what basic TWR does in the worst line."""
    lines = (rig.frequency >= BAND.lowest) & (rig.frequency <= BAND.highest)
    true, wrong = rig.frf[lines], model.frf[lines]
    level, drives = rms(target), _drive_size(rig)
    forward = wrong @ np.linalg.inv(true) * level / level[:, None]
    backward = np.linalg.inv(true) @ wrong * drives / drives[:, None]
    radius = np.abs(np.linalg.eigvals(np.eye(_SIZE) - _GAIN[0] * true @ model.inverse_frf[lines])).max()
    return [f"{value:.2f}" for value in (_off_diagonal(forward), _off_diagonal(backward), radius)]


def _off_diagonal(correction: Matrices) -> float:
    """Size of what is off the diagonal over that of `C - I`, all lines together."""
    inside = np.eye(_SIZE, dtype=bool)
    return float(np.linalg.norm(correction[:, ~inside]) / np.linalg.norm(correction - np.eye(_SIZE)))


def _told(error: float) -> str:
    return percent(error) if error < _DIVERGED else "diverges"


def draw(axes: Axes, title: str, errors: list[NDArray[np.float64]]) -> None:
    """Draw the errors of every algorithm for one mistake."""
    for algorithm, error in zip(ALGORITHMS, errors, strict=True):
        playback = np.arange(1, error.size + 1)
        axes.semilogy(
            playback, 100.0 * error, algorithm.style, ms=3.5, lw=1.1, color=algorithm.colour, label=algorithm.name
        )
    label(axes, title, across="", up="")
    axes.title.set_fontsize(8.5)


if __name__ == "__main__":
    run("input_side_errors", study)
