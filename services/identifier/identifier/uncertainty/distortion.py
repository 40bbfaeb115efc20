"""Robust method: separates noise and stochastic nonlinear distortion by periods and realisations of a multisine.

Periods of one drive differ by noise alone. Experiments with other phases differ by the distortion as well: a nonlinear
rig differs from its Best Linear Approximation, and the difference changes with every draw of the phases.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_record, pseudo_inverse
from identifier.layout import Layout, Window

FEWEST_PERIODS = 2
"""Smallest number of periods of one drive from which its noise can be estimated."""

FEWEST_REALISATIONS = 2
"""Smallest number of sets of phases: experiments of one set share phases, so that their distortion looks linear."""


@dataclass(frozen=True)
class DistortionLevels:
    """Best Linear Approximation of a rig, and noise and distortion of each response. Densities, one-sided, unit^2/Hz.

    Each distortion is a difference of two estimates and may be below 0 by chance if there is none.

    Parameters
    ----------
    frequency
        Shape (lines), in hertz.
    excited
        Shape (lines), boolean; except for the densities at the lines left out, everything is 0 at other lines.
    best_linear_approximation
        Complex, shape (lines, responses, drives), with ``e^{+j omega t}``.
    response_psd
        Shape (lines, responses): PSD of the mean periods.
    noise_psd
        Shape (lines, responses): PSD of the noise in each period.
    distortion_psd
        Shape (lines, responses): PSD of the stochastic nonlinear distortion in each experiment.
    odd_psd, even_psd
        Shape (lines, responses): PSD of the distortion at the odd lines left out and at the even lines, 0 at others;
        None if the excitation has even lines.
    left_out_noise_psd
        Shape (lines, responses): PSD of the noise in each period at the lines of `odd_psd` and `even_psd`, 0 at others;
        None under the same condition.
    periods
        Number of averaged periods in each experiment.
    experiments
        Number of experiments with different phases.
    """

    frequency: NDArray[np.float64]
    excited: NDArray[np.bool_]
    best_linear_approximation: NDArray[np.complex128]
    response_psd: NDArray[np.float64]
    noise_psd: NDArray[np.float64]
    distortion_psd: NDArray[np.float64]
    odd_psd: NDArray[np.float64] | None
    even_psd: NDArray[np.float64] | None
    left_out_noise_psd: NDArray[np.float64] | None
    periods: int
    experiments: int

    @property
    def degrees_of_freedom(self) -> int:
        """Experiments minus drives: number of squares in the estimate of noise plus distortion, per line."""
        return self.experiments - self.best_linear_approximation.shape[2]


def can_separate(layout: Layout, *, drives: int) -> bool:
    """Return whether an experiment allows the separation of noise and distortion.

    `layout`: Layout of the experiment. `drives`: Number of drives of the rig, 1 or more.
    Returns: True for periodic excitations with two periods of each drive, two realisations, and more different
    experiments than drives.
    """
    periods = _periods(layout)
    return (
        layout.periodic
        and min(periods.values()) >= FEWEST_PERIODS
        and has_other_phases(layout)
        and len(periods) > drives
    )


def has_other_phases(layout: Layout) -> bool:
    """Return whether an experiment shows distortion at all, possibly only together with the noise.

    `layout`: Layout of the experiment.
    Returns: False if every block repeats the same sweep or set of phases: distortion repeats itself, too.
    """
    realisations = {capture.realisation for capture in layout.captures}
    return layout.window is Window.HANN or len(realisations) >= FEWEST_REALISATIONS


def separate_distortion(drive: ArrayLike, response: ArrayLike, layout: Layout) -> DistortionLevels:
    """Separate noise and stochastic nonlinear distortion.

    Parameters
    ----------
    drive
        Shape (drives, samples), as played.
    response
        Shape (responses, samples), as measured.
    layout
        Layout of a periodic experiment for which `can_separate` is true.

    Returns
    -------
    DistortionLevels
        Levels at the lines of the layout.

    Raises
    ------
    ValueError
        The experiment does not allow the separation, experiments have different numbers of periods, or the drives are
        dependent at an excited line.

    Notes
    -----
    Source: Pintelon & Schoukens, *System Identification: A Frequency Domain Approach*, chapter 4 (robust method, odd
    multisines with detection lines). Applied to the responses' spectra rather than to FRFs, so that it works for any
    set of experiments, orthogonal or not, with any number of columns.
    """
    inputs, outputs = as_record(drive, name="drive"), as_record(response, name="response")
    periods = _periods(layout)
    if not can_separate(layout, drives=inputs.shape[0]) or len(set(periods.values())) != 1:
        counts = sorted(set(periods.values()))
        raise ValueError(
            f"{len(periods)} different experiments with {counts} periods of {inputs.shape[0]} drives do not tell noise "
            "from distortion; play 2 realisations or more, with more experiments than drives, each with the same 2 "
            "periods or more."
        )
    u, _ = _mean_periods(inputs, layout)
    y, scatter = _mean_periods(outputs, layout)
    experiments, each = len(periods), next(iter(periods.values()))
    scale = 2.0 / (layout.sample_rate * layout.block_samples)
    noise = scale * scatter / (experiments * (each - 1))

    line = np.flatnonzero(layout.excited)
    solution = np.zeros((layout.excited.size, outputs.shape[0], inputs.shape[0]), dtype=np.complex128)
    solution[line] = _least_squares(u[line], y[line], frequency=layout.frequency[line])
    left_over = y[line] - np.matmul(u[line], solution[line].transpose(0, 2, 1))
    total = scale * np.sum(np.abs(left_over) ** 2, axis=1) / (experiments - inputs.shape[0])

    mean_power = scale * np.mean(np.abs(y) ** 2, axis=1)
    odd, even, left_out_noise = _by_parity(mean_power - noise / each, noise, layout)
    return DistortionLevels(
        frequency=layout.frequency,
        excited=layout.excited,
        best_linear_approximation=solution,
        response_psd=_only(mean_power, layout.excited),
        noise_psd=_only(noise, layout.excited),
        distortion_psd=_placed(total - noise[line] / each, line, layout.excited.size),
        odd_psd=odd,
        even_psd=even,
        left_out_noise_psd=left_out_noise,
        periods=each,
        experiments=experiments,
    )


def _periods(layout: Layout) -> dict[tuple[int, int], int]:
    """Return the number of periods of each different drive; repeats of a drive are added."""
    counts: dict[tuple[int, int], int] = {}
    for capture in layout.captures:
        key = capture.realisation, capture.experiment
        counts[key] = counts.get(key, 0) + capture.periods
    return counts


def _mean_periods(record: NDArray[np.float64], layout: Layout) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return the mean spectrum of each experiment's periods, (lines, experiments, channels), and the sum of squares."""
    block = layout.block_samples
    spectra: dict[tuple[int, int], list[NDArray[np.complex128]]] = {}
    for capture in layout.captures:
        stretch = record[:, capture.start : capture.start + capture.periods * block]
        lines = np.fft.rfft(stretch.reshape(record.shape[0], capture.periods, block), axis=2)
        spectra.setdefault((capture.realisation, capture.experiment), []).append(lines)
    means = np.empty((block // 2 + 1, len(spectra), record.shape[0]), dtype=np.complex128)
    scatter = np.zeros((block // 2 + 1, record.shape[0]))
    for index, pieces in enumerate(spectra.values()):
        periods = np.concatenate(pieces, axis=1)
        mean = np.mean(periods, axis=1)
        means[:, index] = mean.T
        scatter += np.sum(np.abs(periods - mean[:, None]) ** 2, axis=1).T
    return means, scatter


def _least_squares(
    u: NDArray[np.complex128], y: NDArray[np.complex128], *, frequency: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return ``H`` in ``y = H u`` at each line, from (lines, experiments, channels)."""
    length = np.linalg.norm(u, axis=1)
    condition = np.linalg.cond(np.divide(u, length[:, None, :], where=length[:, None, :] > 0.0, out=np.zeros_like(u)))
    worst = int(np.argmax(condition))
    if not condition[worst] < 1.0 / np.sqrt(np.finfo(float).eps):
        raise ValueError(
            f"The drives are dependent at {frequency[worst]:.4g} Hz, so no linear approximation can be estimated; "
            "play more experiments, or drives with other phases."
        )
    return np.matmul(pseudo_inverse(u), y).transpose(0, 2, 1)


def _by_parity(
    power: NDArray[np.float64], noise: NDArray[np.float64], layout: Layout
) -> tuple[NDArray[np.float64] | None, ...]:
    """Return the power at the odd and at the even lines without a drive, and the noise at both."""
    even_line = np.arange(layout.excited.size) % 2 == 0
    if np.any(layout.excited & even_line):
        return None, None, None
    in_band = (layout.frequency >= layout.lowest) & (layout.frequency <= layout.highest)
    # Lines without a drive show the rig's own contribution: squares at even lines, cubes at odd ones.
    silent = in_band & ~layout.excited
    return _only(power, silent & ~even_line), _only(power, silent & even_line), _only(noise, silent)


def _only(values: NDArray[np.float64], lines: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.where(lines[:, None], values, 0.0)


def _placed(values: NDArray[np.float64], line: NDArray[np.intp], lines: int) -> NDArray[np.float64]:
    result = np.zeros((lines, values.shape[1]))
    result[line] = values
    return result
