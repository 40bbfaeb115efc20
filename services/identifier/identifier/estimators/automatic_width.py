"""Automatic width of a local method: at each line the neighbourhood with the smallest expected error.

Several widths are fitted to one record. Each is compared with a reference with little bias: H1 of captures without
leakage, the narrowest neighbourhood under a window. Their difference holds the bias of the wider fit and the random
error of the reference that the wider fit does not have; each random error is known from the residual. This is
Mallows' criterion, which for many captures equals leaving out one capture after the other, and which needs no
captures to spare.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from identifier.estimators.averaged_spectra import AveragedSpectra
from identifier.estimators.condition import unit_diagonal
from identifier.estimators.h1 import h1
from identifier.estimators.local_regression import LocalModel, LocalSums
from identifier.estimators.local_solution import LocalSolution, degrees_of_freedom, solve_local
from identifier.estimators.smoothing_check import AMPLE_SURPLUS, SMALLEST_SURPLUS, jaggedness, predicted_power
from identifier.layout import Layout, Window

WIDTH_RATIO = 1.5
"""Ratio of each width to the one before it."""

WIDEST_OF_BLOCKS, WIDEST_OF_NOISE = 27, 72
"""Lines to either side for a capture or a burst, and for a segment of 16 blocks of noise, about 4 lines of a block."""

_NEIGHBOURS = 4
"""Lines to either side over which expected errors are averaged: at a single line they are mostly chance."""

_QUIET = 32
"""Lines to either side that include some without resonances."""


@dataclass(frozen=True)
class Widths:
    """Regressions of one local method over several widths.

    `candidates`: One if the width is given; in rising order if it is chosen. `narrower`: Regression with less bias than
    any candidate; None if H1 is the better reference, or the record allows no narrower one.
    """

    candidates: tuple[LocalSums, ...]
    narrower: LocalSums | None

    @property
    def regressions(self) -> tuple[LocalSums, ...]:
        """Return all regressions, each of which needs the record."""
        return self.candidates if self.narrower is None else (*self.candidates, self.narrower)


def given_width(layout: Layout, *, drives: int, responses: int, model: LocalModel) -> Widths:
    """Return the regression over the width of `model`, and under a window one over half of it."""
    sums = _determined(layout, drives=drives, responses=responses, model=model)
    narrow = max(model.half_width // 2, sums.fewest_half_width(AMPLE_SURPLUS))
    # Without a window H1 is the better reference.
    if layout.window is Window.NONE or narrow >= model.half_width:
        return Widths((sums,), None)
    model = replace(model, half_width=narrow)
    return Widths((sums,), LocalSums(layout, drives=drives, responses=responses, model=model))


def widths_to_try(layout: Layout, *, drives: int, responses: int, model: LocalModel) -> Widths:
    """Return regressions from the narrowest width that determines the unknowns upwards, for any width of `model`."""
    probe = LocalSums(layout, drives=drives, responses=responses, model=replace(model, half_width=1))
    noise = layout.window is Window.HANN
    least = probe.fewest_half_width(SMALLEST_SURPLUS)
    width = max(probe.fewest_half_width(AMPLE_SURPLUS), least + 1 if noise else 1)
    candidates: list[LocalSums] = []
    while not candidates or width <= (WIDEST_OF_NOISE if noise else WIDEST_OF_BLOCKS):
        try:
            trial = replace(model, half_width=width)
            candidates.append(_determined(layout, drives=drives, responses=responses, model=trial))
        except ValueError:
            if not candidates:
                raise
            break
        width = math.ceil(WIDTH_RATIO * width)
    narrower = None
    if noise:
        narrower = _determined(layout, drives=drives, responses=responses, model=replace(model, half_width=least))
    return Widths(tuple(candidates), narrower)


def _determined(layout: Layout, *, drives: int, responses: int, model: LocalModel) -> LocalSums:
    sums = LocalSums(layout, drives=drives, responses=responses, model=model)
    degrees_of_freedom(sums, equations=sums.equations_to_come)
    return sums


def solve_widths(widths: Widths, spectra: AveragedSpectra) -> tuple[LocalSolution, NDArray[np.int64]]:
    """Return the solution with the smallest expected error at each line, and its half width: 0 for H1."""
    lines = np.flatnonzero(spectra.lines)
    s_uu, auto_y = spectra.s_uu[lines], spectra.auto_y[lines]
    solutions, half_widths = _solved(widths.candidates)
    if widths.narrower is not None:
        reference = solve_local(widths.narrower)
    else:
        reference = _h1_solution(spectra, lines, narrowest=solutions[0], half_width=half_widths[0])
        solutions, half_widths = [reference, *solutions], [0, *half_widths]
    residual = reference.residual_psd
    if widths.narrower is None and spectra.independent_averages <= s_uu.shape[1]:
        # A residual from neighbours includes the curvature of resonances, too: only the smallest near a line is noise.
        residual = minimum_filter1d(_averaged_over_neighbours(residual), 2 * _QUIET + 1, axis=0, mode="nearest")
    spread = _random_error(reference, residual, s_uu)
    near = np.maximum(_averaged_over_neighbours(auto_y), np.finfo(np.float64).tiny)
    expected = []
    for solution in solutions:
        # The reference contains the random error of a wider fit, too: their difference lacks it twice.
        error = predicted_power(solution.frf - reference.frf, s_uu) - spread
        error += 2.0 * _random_error(solution, residual, s_uu)
        expected.append(np.sum(_averaged_over_neighbours(error) / near, axis=1))
    choice = np.argmin(expected, axis=0)
    return _joined(solutions, choice), np.array(half_widths)[choice]


def _solved(candidates: tuple[LocalSums, ...]) -> tuple[list[LocalSolution], list[int]]:
    """Solve the solvable ones: within few lines the start of a sweep cannot be distinguished from a transient."""
    solutions, widths = [], []
    for sums in candidates:
        try:
            solutions.append(solve_local(sums))
        except ValueError:
            if sums is candidates[-1] and not solutions:
                raise
        else:
            widths.append(sums.model.half_width)
    return solutions, widths


def _h1_solution(
    spectra: AveragedSpectra, lines: NDArray[np.intp], *, narrowest: LocalSolution, half_width: int
) -> LocalSolution:
    """Return H1 of captures without leakage as a solution like those of the local methods."""
    s_uu, s_yu, auto_y = spectra.s_uu[lines], spectra.s_yu[lines], spectra.auto_y[lines]
    scale, scaled = unit_diagonal(s_uu, spectra.frequency[lines])
    frf = h1(s_yu, scaled, scale)
    averages, drives = spectra.independent_averages, s_uu.shape[1]
    freedom = averages - drives
    if freedom > 0.0:
        explained = np.einsum("fij,fij->fi", frf, s_yu.conj()).real
        residual = np.maximum(auto_y - explained, 0.0) * (averages / freedom)
        degrees = np.full(lines.size, freedom)
    else:
        # With as many captures as drives no residual is left: use that of few lines, or the change from line to line.
        residual = np.minimum(narrowest.residual_psd, jaggedness(frf, s_uu, half_width) * (averages / drives))
        degrees = narrowest.degrees_of_freedom
    weight = np.einsum("fjj->fj", np.linalg.inv(scaled)).real / scale**2 / averages
    return LocalSolution(
        frf=frf,
        residual_psd=residual,
        explained=np.clip(1.0 - residual / np.where(auto_y > 0.0, auto_y, 1.0), 0.0, 1.0),
        drive_weight=weight,
        degrees_of_freedom=degrees,
    )


def _random_error(
    solution: LocalSolution, residual_psd: NDArray[np.float64], s_uu: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return the response power of a solution's random error with the drives, shape (lines, responses).

    The residual is the reference's, because that of a wider neighbourhood includes its bias.
    """
    share = np.sum(np.einsum("fjj->fj", s_uu).real * solution.drive_weight, axis=1)
    return share[:, None] * residual_psd


def _averaged_over_neighbours(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean over lines near each one, shape (lines, ...); fewer at the edges."""
    last = values.shape[0]
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    low = np.maximum(np.arange(last) - _NEIGHBOURS, 0)
    high = np.minimum(np.arange(last) + _NEIGHBOURS + 1, last)
    return (sums[high] - sums[low]) / (high - low)[:, None]


def _joined(solutions: list[LocalSolution], choice: NDArray[np.intp]) -> LocalSolution:
    line = np.arange(choice.size)
    names = ("frf", "residual_psd", "explained", "drive_weight", "degrees_of_freedom")
    values = {name: np.stack([getattr(each, name) for each in solutions])[choice, line] for name in names}
    return LocalSolution(**values)
