"""Spectra of the steps between playbacks, each computed once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_spectra import CrossSpectra, count_blocks, hann_periodic, hop_samples, independent_averages, smooth_lines
from iterator.model.drive_terms import DriveTerm
from iterator.model.history import IterationHistory, Playback

SMOOTHED_LINES: Final = 5
"""Number of lines that are averaged in a smoothed line."""


@dataclass(frozen=True)
class StepSpectra:
    """Averaged spectra of steps of drive and response, one-sided densities.

    `response_with_drive`, shape (lines, n_y, inputs): `S̄_ΔyΔu`; the inputs are the drives, followed term by term by
    the nonlinear terms of the steps. `drive`, shape (lines, inputs, inputs): `S̄_ΔuΔu`, for the same inputs. Spectra of
    the drives have the same bytes with any terms. `response`, shape (lines, n_y): Diagonal of `S̄_ΔyΔy`.
    """

    response_with_drive: NDArray[np.complex128]
    drive: NDArray[np.complex128]
    response: NDArray[np.float64]

    def unexplained(self, by: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the response energy that a matrix of all inputs does not explain; 0 if rounding makes it negative."""
        explained = 2.0 * np.einsum("fij,fij->fi", by.conj(), self.response_with_drive).real
        modelled = np.einsum("fij,fij->fi", np.matmul(by, self.drive), by.conj()).real
        return np.maximum(self.response - explained + modelled, 0.0)

    def of_inputs(self, kept: NDArray[np.intp]) -> StepSpectra:
        """Return the spectra of some of the inputs."""
        return StepSpectra(
            np.ascontiguousarray(self.response_with_drive[:, :, kept]),
            np.ascontiguousarray(self.drive[:, kept[:, None], kept]),
            self.response,
        )


@dataclass(frozen=True)
class StepBlocks:
    """Division of steps into blocks, and the fitted lines.

    `block_samples`: Even number of samples in a block; half a block of zeros is added before and after, so that ends
    count and any length is allowed. `overlap`: Overlap of the blocks, 0 up to but not including 1. `sample_rate`: Hz.
    `first`, `last`: First and last line at which the rig is fitted. `terms`: Nonlinear terms of the drives that are
    further inputs.
    """

    block_samples: int
    overlap: float
    sample_rate: float
    first: int
    last: int
    terms: tuple[DriveTerm, ...] = ()

    @property
    def around(self) -> slice:
        """Fitted lines and their existing neighbours, which are used in the smoothing."""
        reach, available = SMOOTHED_LINES // 2, self.block_samples // 2 + 1
        start = max(0, min(self.first - reach, available - SMOOTHED_LINES))
        return slice(start, min(available, max(self.last + reach + 1, start + SMOOTHED_LINES)))

    def independent_averages(self, samples: int) -> float:
        """Return the number of independent blocks in the spectra of a step of `samples` samples."""
        hop = hop_samples(self.block_samples, self.overlap)
        blocks = count_blocks(samples + self.block_samples, self.block_samples, self.overlap)
        return independent_averages(hann_periodic(self.block_samples), hop, blocks)


@dataclass(frozen=True)
class SeenStep:
    """A step with its spectra.

    `before`: Playback at its start; None is zero. `after`: Playback at its end. `blocks`: Its division into blocks.
    `mean_square`, shape (n_y,): Mean square of the response's step. `spectra`: Not smoothed, at the lines
    `blocks.around`.
    """

    before: Playback | None
    after: Playback
    blocks: StepBlocks
    mean_square: NDArray[np.float64]
    spectra: StepSpectra


@dataclass(frozen=True)
class ForeseenStep:
    """A step and its prediction errors by models that were fitted to the steps before it.

    `step`: The step. `fitted_with`: Settings and weights of those fits. `left`: Share of the step's energy that each
    model leaves unexplained; one value for each set of inputs.
    """

    step: SeenStep
    fitted_with: object
    left: tuple[float, ...]


def seen_steps(
    history: IterationHistory,
    blocks: StepBlocks,
    *,
    before: tuple[SeenStep, ...] = (),
    earlier: tuple[tuple[Playback, ...], ...] = (),
) -> tuple[SeenStep, ...]:
    """Compute the spectra of all steps `Δu_j = u_j - u_{j-1}` and `Δy_j`; `u_0 = y_0 = 0`, in each campaign.

    `history`: With one playback or more, or with `earlier` ones: those of earlier campaigns, whose steps come first.
    `blocks`: Division of the steps. `before`: Result of an earlier call. Steps between the same playbacks with the
    same blocks are taken from it: they would be identical, byte for byte.
    Returns: Steps from the first to the last.
    """
    lines = (*earlier, history.playbacks)
    known = {(id(step.before), id(step.after)): step for step in before if step.blocks == blocks}
    # Made when the first step of its length needs it; only the part between the zeros is written.
    padded: NDArray[np.float64] | None = None
    steps: list[SeenStep] = []
    for start, end in (pair for line in lines for pair in zip((None, *line[:-1]), line, strict=False)):
        step = known.get((id(start), id(end)))
        if step is None:
            channels = end.response.shape[0] + end.drive.shape[0] * (1 + len(blocks.terms))
            shape = (channels, end.drive.shape[1] + blocks.block_samples)
            if padded is None or padded.shape != shape:
                padded = np.zeros(shape)
            step = _seen(start, end, blocks, padded)
        steps.append(step)
    return tuple(steps)


def averaged_steps(
    steps: tuple[SeenStep, ...], *, forgetting: float, response_weight: NDArray[np.float64], each_line: bool = False
) -> StepSpectra:
    """Average the spectra of steps with the largest weight for the latest ones.

    Each step has the weight `φ^(k-j)` over its weighted mean square, so that small late steps count as much as the
    large first one. All records of a campaign have the same number of blocks, so that needs no weight.

    `steps`: One or more, with the same blocks. `forgetting`: `φ`, in (0, 1]. `response_weight`, shape (n_y,): 0 or
    more, one over the target's RMS. `each_line`: Whether the lines are not smoothed.
    Returns: Spectra at the fitted lines, smoothed over their neighbours with [1 2 3 2 1] / 9.
    """
    kept = steps[0].spectra
    cross, drive, response = (np.zeros_like(kind) for kind in (kept.response_with_drive, kept.drive, kept.response))
    # The latest first, so that the largest weight is added to zero.
    for age, step in enumerate(reversed(steps)):
        power = float(step.mean_square @ response_weight**2) / response_weight.size
        if power > 0.0:
            weight = forgetting**age / power
            cross += weight * step.spectra.response_with_drive
            drive += weight * step.spectra.drive
            response += weight * step.spectra.response
    blocks = steps[0].blocks
    fitted = slice(blocks.first - blocks.around.start, blocks.last + 1 - blocks.around.start)
    if each_line:
        of_cross, of_drive = (np.asarray(each[fitted], dtype=np.complex128) for each in (cross, drive))
        return StepSpectra(of_cross, of_drive, np.asarray(response[fitted], dtype=np.float64))
    return StepSpectra(smooth_lines(cross)[fitted], smooth_lines(drive)[fitted], smooth_lines(response)[fitted])


def term_change(term: DriveTerm, start: Playback | None, end: Playback) -> NDArray[np.float64]:
    """Return the change of a nonlinear term of the drives, without its mean, which would leak into the lowest lines."""
    change = term.values(end.drive)
    if start is not None:
        change -= term.values(start.drive)
    return np.asarray(change - np.mean(change, axis=1, keepdims=True))


def _seen(start: Playback | None, end: Playback, blocks: StepBlocks, padded: NDArray[np.float64]) -> SeenStep:
    n_y, n_u, half = end.response.shape[0], end.drive.shape[0], blocks.block_samples // 2
    step_y, step_u, *of_terms = (
        record[:, half:-half] for record in np.split(padded, np.arange(n_y, padded.shape[0], n_u))
    )
    np.subtract(end.response, 0.0 if start is None else start.response, out=step_y)
    np.subtract(end.drive, 0.0 if start is None else start.drive, out=step_u)
    for term, step_f in zip(blocks.terms, of_terms, strict=True):
        step_f[:] = term_change(term, start, end)
    averages = CrossSpectra(
        n_y,
        padded.shape[0] - n_y,
        block_samples=blocks.block_samples,
        overlap=blocks.overlap,
        sample_rate=blocks.sample_rate,
        chosen=blocks.around,
        further=n_u * len(blocks.terms),
    )
    averages.add(padded[:n_y], padded[n_y:])
    found = averages.estimate()
    return SeenStep(
        before=start,
        after=end,
        blocks=blocks,
        mean_square=np.einsum("ct,ct->c", step_y, step_y) / step_y.shape[1],
        spectra=StepSpectra(found.s_ab, found.s_bb, found.auto_a),
    )
