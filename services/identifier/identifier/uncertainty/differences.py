"""Difference of two models of one rig, and the part of it that noise explains."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ModelDifference:
    """Difference of two FRF matrices, in each response to the first experiment's drives.

    `relative`: Shape (lines, responses): RMS of the change over RMS of the response; 0 outside the lines of both.
    `by_chance`: Same shape: the same from the random errors of both alone.
    """

    relative: NDArray[np.float64]
    by_chance: NDArray[np.float64]


def model_difference(
    first: NDArray[np.complex128],
    second: NDArray[np.complex128],
    *,
    drive_psd: NDArray[np.float64],
    first_variance: NDArray[np.float64],
    second_variance: NDArray[np.float64],
    lines: NDArray[np.bool_],
) -> ModelDifference:
    """Compare two models of one rig.

    Parameters
    ----------
    first, second
        Complex, shape (lines, responses, drives).
    drive_psd
        Shape (lines, drives): PSD of the drives, as their weight.
    first_variance, second_variance
        Shape (lines, responses, drives): variance of every element.
    lines
        Shape (lines): lines at which both were identified.

    Returns
    -------
    ModelDifference
        Difference at these lines, 0 elsewhere.
    """
    size = _power(np.abs(first) ** 2, drive_psd, lines)
    change = _power(np.abs(second - first) ** 2, drive_psd, lines)
    chance = _power(first_variance + second_variance, drive_psd, lines)
    relative, by_chance = np.zeros(change.shape), np.zeros(change.shape)
    relative[lines] = np.sqrt(change[lines] / size[lines])
    by_chance[lines] = np.sqrt(chance[lines] / size[lines])
    return ModelDifference(relative=relative, by_chance=by_chance)


def difference_sentences(
    difference: ModelDifference, *, frequency: NDArray[np.float64], responses: Sequence[str]
) -> tuple[str, ...]:
    """Return sentences on the differences of two models.

    `difference`: From `model_difference`. `frequency`: Shape (lines), in hertz. `responses`: Names of the channels, in
    order.
    Returns: One sentence for each.
    """
    held = np.flatnonzero(np.any(difference.relative > 0.0, axis=1))
    sentences = []
    for i, name in enumerate(responses):
        channel = name.replace("_", " ")
        if held.size == 0:
            sentences.append(f"The models do not differ in {channel}.")
            continue
        middle, chance = (float(np.median(part[held, i])) for part in (difference.relative, difference.by_chance))
        worst = held[int(np.argmax(difference.relative[held, i]))]
        sentences.append(
            f"The models differ by {100 * middle:.0f} % in {channel} (median over the band; {100 * chance:.0f} % by "
            f"chance), at most by {100 * difference.relative[worst, i]:.0f} % at {frequency[worst]:.3g} Hz."
        )
    return tuple(sentences)


def _power(
    squares: NDArray[np.float64], drive_psd: NDArray[np.float64], lines: NDArray[np.bool_]
) -> NDArray[np.float64]:
    return np.where(lines[:, None], np.einsum("fij,fj->fi", squares, drive_psd), 0.0)
