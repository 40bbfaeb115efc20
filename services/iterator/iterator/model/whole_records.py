"""Steps at the lines of their whole records: a fit at each line follows the slope of what the model lacks."""

from __future__ import annotations

from typing import Final, cast

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from iterator.model.interpolated_product import InterpolatedMatrix
from iterator.model.rig import RigModel
from iterator.model.step_spectra import SeenStep, StepSpectra, term_change

# Reach of a fit to each side, in lines of the model's blocks, and the fewest lines of the record in it.
_REACH: Final = 3
_FEWEST: Final = 20
# Reach of the mean that a step is weighted by, in lines of the blocks.
_REACH_OF_WEIGHT: Final = 7
# Keeps the fit of slopes stable, relative to the energy of each.
_SLOPE_PRIOR: Final = 1e-3
# (Σw)²/Σw² of the tricube weights, over half their number.
_INDEPENDENT: Final = 1.41


class WholeRecords:
    """Spectra of steps for a fit whose difference from the identified model may change with frequency.

    Around each line, the part of a step's response that the identified model does not predict is `(D_0 + D_1 x) ΔU`,
    with `x` the distance from the line. A record begins and ends at rest, so its transform has no leakage. `D_1` is
    eliminated here, by least squares; the spectra are those of the equations that are left for `D_0`.

    Source: J. Schoukens and R. Pintelon's local polynomial method, with the difference from a known model in the place
    of the FRF, and without the transients.

    `model`: Model with the lines. `identified`, shape (lines, n_y, n_u): Identified FRF at them.
    """

    def __init__(self, model: RigModel, identified: NDArray[np.complex128]) -> None:
        self._frequency = model.frequency[model.identified]
        self._known = identified[model.identified]
        self._identified = identified
        self._sums: dict[int, tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]] = {}

    def averaged(
        self, steps: tuple[SeenStep, ...], *, forgetting: float, response_weight: NDArray[np.float64]
    ) -> StepSpectra:
        """Average the spectra of steps, each at each line by its age and over its response's energy near that line.

        `steps`: One or more, with the same blocks. `forgetting`: `φ`, in (0, 1]. `response_weight`, shape (n_y,).
        Returns: Spectra at the fitted lines.
        """
        blocks, drives = steps[0].blocks, steps[0].after.drive.shape[0]
        kept = drives * (1 + len(blocks.terms))
        identified = self._identified[blocks.first : blocks.last + 1]
        lines, n_y = identified.shape[:2]
        inputs = np.zeros((lines, kept + drives, kept + drives), dtype=np.complex128)
        cross = np.zeros((lines, n_y, kept + drives), dtype=np.complex128)
        response = np.zeros((lines, n_y))
        for age, step in enumerate(reversed(steps)):
            weight = forgetting**age * _one_over_energy_near(step, response_weight)
            of_inputs, of_cross, of_response = self._sums_of(step)
            inputs += weight[:, None, None] * of_inputs
            cross += weight[:, None, None] * of_cross
            response += weight[:, None] * of_response
        slopes = slice(kept, None)
        size = np.sqrt(np.einsum("fii->fi", inputs[:, slopes, slopes]).real)
        size[size == 0.0] = 1.0
        levelled = inputs[:, slopes, slopes] / size[:, :, None] / size[:, None, :] + _SLOPE_PRIOR * np.eye(drives)
        spread = np.linalg.inv(levelled) / size[:, :, None] / size[:, None, :]
        from_slopes = inputs[:, :kept, slopes]
        drive = inputs[:, :kept, :kept] - from_slopes @ spread @ from_slopes.conj().swapaxes(1, 2)
        lacking = cross[:, :, :kept] - cross[:, :, slopes] @ spread @ from_slopes.conj().swapaxes(1, 2)
        response -= np.einsum("fij,fjk,fik->fi", cross[:, :, slopes], spread, cross[:, :, slopes].conj()).real
        # With the identified model again, as the fit expects it.
        predicted = identified @ drive[:, :drives]
        response += 2.0 * np.einsum("fij,fij->fi", identified.conj(), lacking[:, :, :drives]).real
        response += np.einsum("fij,fij->fi", predicted[:, :, :drives], identified.conj()).real
        return StepSpectra(lacking + predicted, drive, np.maximum(response, 0.0))

    @staticmethod
    def averages(steps: tuple[SeenStep, ...], *, forgetting: float) -> float:
        """Return the number of independent lines in a fit to steps."""
        weight = forgetting ** np.arange(len(steps))
        samples, block = steps[0].after.drive.shape[1], steps[0].blocks.block_samples
        lines = _INDEPENDENT * max(_REACH * samples / block, _FEWEST)
        return float(lines * np.sum(weight) ** 2 / np.sum(weight**2))

    def _sums_of(self, step: SeenStep) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]:
        """Return the sums around each line over inputs and slopes, over what the model lacks with them, and over it."""
        if id(step) not in self._sums:
            self._sums[id(step)] = self._summed(step)
        return self._sums[id(step)]

    def _summed(self, step: SeenStep) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]:
        blocks, samples = step.blocks, step.after.drive.shape[1]
        length = cast(int, next_fast_len(samples + blocks.block_samples, real=True))
        per_line = length / blocks.block_samples
        reach = max(_REACH * per_line, _FEWEST * length / samples)
        # Not 0 Hz, where a response in a band has nothing.
        begin = max(int(blocks.first * per_line - reach), 1)
        end = min(int(blocks.last * per_line + reach) + 1, length // 2)
        before, after = step.before, step.after
        changes = [after.drive if before is None else after.drive - before.drive]
        changes += [term_change(term, before, after) for term in blocks.terms]
        inputs = np.concatenate([np.fft.rfft(change, n=length, axis=1)[:, begin : end + 1] for change in changes])
        drives = after.drive.shape[0]
        response = after.response if before is None else after.response - before.response
        frequency = np.arange(begin, end + 1, dtype=np.float64) * (blocks.sample_rate / length)
        at = np.clip(frequency, float(self._frequency[0]), float(self._frequency[-1]))
        predicted = InterpolatedMatrix(self._frequency, self._known, at=at).times(inputs[:drives])
        lacking = np.fft.rfft(response, n=length, axis=1)[:, begin : end + 1] - predicted
        lines, n_y, columns = blocks.last + 1 - blocks.first, lacking.shape[0], inputs.shape[0] + drives
        of_inputs = np.empty((lines, columns, columns), dtype=np.complex128)
        of_lacking = np.empty((lines, n_y, columns), dtype=np.complex128)
        energy = np.empty((lines, n_y))
        for row in range(lines):
            centre = round((blocks.first + row) * per_line)
            around = np.arange(max(centre - int(reach), begin), min(centre + int(reach), end) + 1)
            distance = (around - centre) / reach
            weight = (1.0 - np.abs(distance) ** 3) ** 3
            weight /= np.sum(weight)
            near = slice(around[0] - begin, around[-1] + 1 - begin)
            near_inputs = np.concatenate([inputs[:, near], inputs[:drives, near] * distance])
            weighted = (near_inputs * weight).conj().T
            of_inputs[row], of_lacking[row] = near_inputs @ weighted, lacking[:, near] @ weighted
            energy[row] = np.square(np.abs(lacking[:, near])) @ weight
        return of_inputs, of_lacking, energy


def _one_over_energy_near(step: SeenStep, response_weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return one over the weighted energy density of a step's response around each line; 0 for a step of zeros."""
    density = step.spectra.response @ response_weight**2
    total = np.concatenate(([0.0], np.cumsum(density)))
    lines = np.arange(step.blocks.first, step.blocks.last + 1) - step.blocks.around.start
    first, last = np.maximum(lines - _REACH_OF_WEIGHT, 0), np.minimum(lines + _REACH_OF_WEIGHT + 1, density.size)
    mean = (total[last] - total[first]) / (last - first)
    return np.divide(1.0, mean, out=np.zeros_like(mean), where=mean > 0.0)
