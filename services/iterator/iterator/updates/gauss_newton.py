"""Cautious Gauss-Newton step: least squares of the error that a model with nonlinear terms predicts for a step."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from iterator.band import ControlBand, LowerRate
from iterator.model import InterpolatedMatrix, RigModel, gram_and_ridge, speed_of_lines

_TURNS: Final = 2
_CONJUGATE_GRADIENTS: Final = 6
# The same with terms of speeds: their slopes jump where a drive turns, and the mean tangent is far from the matrix.
_TURNS_WITH_SPEEDS: Final = 4
_CONJUGATE_GRADIENTS_WITH_SPEEDS: Final = 20
# Number of times that a change is halved if it does not lower the objective, before it is dropped.
_HALVINGS: Final = 3
# Share of the gradient's energy below which a linear problem is solved.
_SOLVED: Final = 1e-6
# Sample rate of the terms over twice the band's end: products of three drives do not alias into the band.
_OVERSAMPLING: Final = 2.0


class StepProblem:
    """Prediction of a model with terms for a step from a drive: `Δŷ = H x + Σ B_t (t(u + x) - t(u))`.

    All quantities are at lines of the band, in scaled units: drives over `drive_scale`, responses times
    `response_weight`. A step is `x = L v`, with `L Lᴴ = (JᴴJ + R)⁻¹` of the mean tangent `J`, so that conjugate
    gradients in `v` begin with the cautious inverse. `R` is the tangent's uncertainty plus the ridge of the inverse;
    its root is below the responses, and a step costs `‖residual‖² + ‖R^½ x‖²`. `frf` is `H` at the lines, `model.frf`
    the mean tangent. A term of speeds has the change of the drive's speed in the place of `x`.
    """

    def __init__(
        self,
        model: RigModel,
        *,
        lines: NDArray[np.intp],
        frf: NDArray[np.complex128],
        uncertainty: NDArray[np.complex128],
        regularisation: float,
        response_weight: NDArray[np.float64],
        drive_scale: NDArray[np.float64],
        drive: NDArray[np.float64],
        band: ControlBand,
    ) -> None:
        if model.term_frf is None:
            raise AssertionError("A model without terms has a step without iteration.")
        samples, n_u = drive.shape[1], drive_scale.size
        self._samples = samples
        self._transform = band.transform(samples)
        self._mask = band.drive_mask(self._transform.frequency)
        self._weight, self._scale, self._terms = response_weight, drive_scale, model.terms
        self.frequency: NDArray[np.float64] = self._transform.frequency
        """Frequencies of the lines in the band, Hz: ndarray, shape (lines,)."""
        lower = LowerRate(self._transform, oversampling=_OVERSAMPLING)
        self._in_time, self._in_lines = lower.in_time, lower.in_lines
        scaled = drive / drive_scale[:, None]
        # By whether it is a speed.
        self._arguments = {term.is_of_speed: lower.record(term.argument(scaled)) for term in model.terms}
        self._before = tuple(term.of(self._arguments[term.is_of_speed]) for term in model.terms)
        self._speed = speed_of_lines(self.frequency, sample_rate=band.sample_rate)
        linear = frf * response_weight[:, None] * drive_scale
        # Terms of scaled drives are scaled by the drives' scale to their power.
        powers = np.concatenate([drive_scale**term.degree for term in model.terms])
        of_terms = model.term_frf[lines] * response_weight[:, None] * powers
        nothing = np.zeros((n_u, self.frequency.size), dtype=np.complex128)
        played = max(1, int(samples * lower.share))
        speed = speed_of_lines(model.frequency[lines], sample_rate=band.sample_rate)[:, None, None]
        slopes = np.concatenate(
            [
                (speed if term.is_of_speed else np.ones_like(speed)) * np.diag(np.mean(slope[:, :played], axis=1))
                for term, slope in zip(model.terms, self.slopes(nothing), strict=True)
            ],
            axis=1,
        )
        tangent = linear + np.matmul(of_terms, slopes)
        # The uncertainty refers to terms that are not scaled.
        of_drives = np.broadcast_to(np.eye(n_u, dtype=np.complex128), (lines.size, n_u, n_u))
        of_inputs = np.concatenate((of_drives, slopes * powers[:, None]), axis=1)
        gram, ridge = gram_and_ridge(tangent, regularisation=regularisation)
        doubt = np.matmul(_adjoint(of_inputs), np.matmul(uncertainty, of_inputs)) + ridge
        conditioner = np.linalg.cholesky(np.linalg.inv(gram + doubt))
        caution = np.concatenate(
            (_adjoint(np.linalg.cholesky(doubt)), np.zeros_like(doubt, shape=(lines.size, n_u, powers.size))), axis=2
        )
        rows = np.concatenate((np.concatenate((linear, of_terms), axis=2), caution), axis=1)
        known = model.frequency[lines]
        at = np.clip(self.frequency, known[0], known[-1])
        self._rows, self._rows_back = (InterpolatedMatrix(known, each, at=at) for each in (rows, _adjoint(rows)))
        self._conditioner, self._conditioner_back = (
            InterpolatedMatrix(known, each, at=at) for each in (conditioner, _adjoint(conditioner))
        )

    @property
    def has_speeds(self) -> bool:
        """Whether a term is one of speeds."""
        return True in self._arguments

    def wanted(self, missing: NDArray[np.float64], *, gain: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the wanted rows of a step: the missing response times its gain, at no cost."""
        rows = np.zeros((self._weight.size + self._scale.size, self.frequency.size), dtype=np.complex128)
        for record, row in zip(missing, rows, strict=False):
            self._transform.lines(record, weight=self._mask, out=row)
        rows[: self._weight.size] *= gain.T * self._weight[:, None]
        return rows

    def rows(self, step: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the predicted response to a step, and below it the cost of the step."""
        after = self._after(step)
        of_terms = (
            self._in_lines(term.of(after[term.is_of_speed]) - before)
            for term, before in zip(self._terms, self._before, strict=True)
        )
        return self._rows.times(np.concatenate((step, *of_terms)))

    def slopes(self, step: NDArray[np.complex128]) -> tuple[NDArray[np.float64], ...]:
        """Return the derivative of each term by its argument at each sample after a step."""
        after = self._after(step)
        return tuple(term.slopes(after[term.is_of_speed]) for term in self._terms)

    def forward(
        self, slopes: tuple[NDArray[np.float64], ...], conditioned: NDArray[np.complex128]
    ) -> NDArray[np.complex128]:
        """Return the derivative of the rows along a change of `v`."""
        change = self.step(conditioned)
        moved = self._moved(change)
        of_terms = (
            self._in_lines(slope * moved[term.is_of_speed]) for term, slope in zip(self._terms, slopes, strict=True)
        )
        return self._rows.times(np.concatenate((change, *of_terms)))

    def backward(self, slopes: tuple[NDArray[np.float64], ...], rows: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the adjoint of `forward` applied to rows."""
        change, *of_terms = np.split(self._rows_back.times(rows), 1 + len(slopes))
        in_time = {is_of_speed: np.zeros_like(before) for is_of_speed, before in self._arguments.items()}
        for term, slope, lines in zip(self._terms, slopes, of_terms, strict=True):
            in_time[term.is_of_speed] += slope * self._in_time(lines)
        for is_of_speed, samples in in_time.items():
            lines = self._in_lines(samples)
            change = change + (self._speed.conj() * lines if is_of_speed else lines)
        return self._conditioner_back.times(change)

    def _moved(self, step: NDArray[np.complex128]) -> dict[bool, NDArray[np.float64]]:
        """Return the changes of the arguments by a step, as samples."""
        return {
            is_of_speed: self._in_time(self._speed * step if is_of_speed else step) for is_of_speed in self._arguments
        }

    def _after(self, step: NDArray[np.complex128]) -> dict[bool, NDArray[np.float64]]:
        moved = self._moved(step)
        return {is_of_speed: before + moved[is_of_speed] for is_of_speed, before in self._arguments.items()}

    def step(self, conditioned: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return `x = L v`."""
        return self._conditioner.times(conditioned)

    def samples(self, step: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return a step as samples, shape (n_u, samples), drive units."""
        result = np.empty((self._scale.size, self._samples))
        for lines, row in zip(step, result, strict=True):
            self._transform.samples(lines, out=row)
        return result * self._scale[:, None]


def gauss_newton_step(
    problem: StepProblem, *, missing: NDArray[np.float64], gain: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the step that gives the missing part of the responses, as far as the gain allows.

    `missing`, shape (n_y, samples): Response units. `gain`, shape (lines, n_y): Gain at the problem's lines.
    Returns: Step in drive units, shape (n_u, samples).
    Source: the Gauss-Newton method with conjugate gradients, as in J. Nocedal, S. J. Wright, *Numerical Optimization*.
    """
    wanted = problem.wanted(missing, gain=gain)
    step = np.zeros((wanted.shape[0] - missing.shape[0], wanted.shape[1]), dtype=np.complex128)
    left, objective = wanted, _energy(wanted)
    turns, gradients = _TURNS, _CONJUGATE_GRADIENTS
    if problem.has_speeds:
        turns, gradients = _TURNS_WITH_SPEEDS, _CONJUGATE_GRADIENTS_WITH_SPEEDS
    for _ in range(turns):
        change = problem.step(_least_squares(problem, problem.slopes(step), left, gradients=gradients))
        for _ in range(_HALVINGS + 1):
            left_then = wanted - problem.rows(step + change)
            objective_then = _energy(left_then)
            if objective_then < objective:
                step, left, objective = step + change, left_then, objective_then
                break
            change *= 0.5
        else:
            break
    return problem.samples(step)


def _least_squares(
    problem: StepProblem, slopes: tuple[NDArray[np.float64], ...], left: NDArray[np.complex128], *, gradients: int
) -> NDArray[np.complex128]:
    """Solve for the change of `v` that gives the remaining rows, by a few conjugate gradients."""
    gradient = problem.backward(slopes, left)
    found, direction = np.zeros_like(gradient), gradient
    energy = first = _energy(gradient)
    for to_come in reversed(range(gradients)):
        if energy <= _SOLVED * first:
            break
        made = problem.forward(slopes, direction)
        share = energy / _energy(made)
        found = found + share * direction
        if not to_come:
            # The next gradient would cost as much as half an iteration, and no direction follows from it any more.
            break
        left = left - share * made
        gradient = problem.backward(slopes, left)
        energy, before = _energy(gradient), energy
        direction = gradient + (energy / before) * direction
    return found


def _energy(lines: NDArray[np.complex128]) -> float:
    return float(np.sum(np.square(lines.view(np.float64))))


def _adjoint(matrix: NDArray[np.complex128]) -> NDArray[np.complex128]:
    return np.ascontiguousarray(matrix.conj().transpose(0, 2, 1))
