"""Conversion of settings to the drive of an experiment and its layout."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from duralab_settings import ExcitationKind
from identifier.excitation.burst_random import burst_random
from identifier.excitation.crest_factor import minimise_crest_factor
from identifier.excitation.fades import linear_fades
from identifier.excitation.levels import scale_to_levels
from identifier.excitation.multisine import block_of, line_amplitudes
from identifier.excitation.orthogonal import draw_phases
from identifier.excitation.random_noise import pure_random
from identifier.excitation.schedule import burst_samples, schedule_experiment
from identifier.excitation.settings import ExperimentSettings
from identifier.excitation.swept_sine import swept_sine
from identifier.layout import Capture, Layout


@dataclass(frozen=True)
class Experiment:
    """The drive to play, and its layout for the estimator.

    Parameters
    ----------
    drive
        Shape (drives, samples), each row in its channel's unit.
    layout
        Positions of its captures and its excited lines.
    """

    drive: NDArray[np.float64]
    layout: Layout


def design_experiment(
    settings: ExperimentSettings,
    *,
    drives: int,
    sample_rate: float,
    mixing: NDArray[np.complex128] | None = None,
) -> Experiment:
    """Make the drive of an experiment.

    Parameters
    ----------
    settings
        Settings, valid when constructed.
    drives
        Number of drives of the rig, 1 or more.
    sample_rate
        Sample rate of the rig, in hertz.
    mixing
        Complex, shape (block_samples // 2 + 1, drives, drives), of a multisine: each drive is the sum of the multisines
        at their levels, multiplied by its row at each line. Left out: each drive is its own multisine.

    Returns
    -------
    Experiment
        Same bytes for the same arguments; not yet checked against the rig's limits, see `check_levels`.

    Raises
    ------
    SettingsError
        The settings do not fit the rig.
    """
    layout = schedule_experiment(settings, drives=drives, sample_rate=sample_rate)
    if settings.kind is ExcitationKind.PURE_RANDOM:
        drive = pure_random(
            settings.spectra,
            rms=[1.0] * drives,
            samples=layout.samples,
            fade_samples=layout.fade_samples,
            sample_rate=sample_rate,
            seed=settings.seed,
        )
    elif settings.kind.is_multisine:
        drive = _multisines(settings, layout, mixing)
    else:
        drive = _bursts(settings, layout)
    if mixing is None:
        scale_to_levels(drive, layout=layout, levels=settings.levels, level_kind=settings.level_kind)
    drive.setflags(write=False)
    return Experiment(drive=drive, layout=layout)


def _bursts(settings: ExperimentSettings, layout: Layout) -> NDArray[np.float64]:
    length, fade = burst_samples(settings), settings.fade_samples(layout.sample_rate)
    if settings.kind is ExcitationKind.BURST_RANDOM:
        return burst_random(
            settings.spectra,
            bursts=len(layout.captures),
            block_samples=layout.block_samples,
            burst_samples=length,
            fade_samples=fade,
            sample_rate=layout.sample_rate,
            seed=settings.seed,
        )
    columns = 1 + max(capture.experiment for capture in layout.captures)
    return swept_sine(
        settings.spectra,
        sets=len(layout.captures) // columns,
        block_samples=layout.block_samples,
        sweep_samples=length,
        fade_samples=fade,
        sample_rate=layout.sample_rate,
    )


def _multisines(
    settings: ExperimentSettings, layout: Layout, mixing: NDArray[np.complex128] | None
) -> NDArray[np.float64]:
    """Return the blocks of all experiments in sequence, each fading into the next during the next one's delay."""
    block, fade = layout.block_samples, layout.fade_samples
    drive = np.zeros((len(settings.spectra), layout.samples))
    for capture, period in _periods(settings, layout, mixing):
        start = capture.start - layout.delay_blocks * block
        blocks = layout.delay_blocks + capture.periods
        length = blocks * block + fade
        piece = np.tile(period, (1, blocks + -(-fade // block)))[:, :length]
        drive[:, start : start + length] += piece * linear_fades(length, fade)
    return drive


def _periods(
    settings: ExperimentSettings, layout: Layout, mixing: NDArray[np.complex128] | None
) -> Iterator[tuple[Capture, NDArray[np.float64]]]:
    """Yield each capture with its period, shape (drives, block_samples); one realisation in memory at a time."""
    amplitude = line_amplitudes(settings.spectra, frequency=layout.frequency, excited=layout.excited)
    for realisation, captures in groupby(layout.captures, key=lambda capture: capture.realisation):
        phases = draw_phases(
            settings.kind,
            drives=len(settings.spectra),
            lines=layout.excited.size,
            realisation=realisation,
            seed=settings.seed,
        )
        if settings.minimise_crest_factor:
            phases = minimise_crest_factor(phases, amplitude)
        lines = phases.lines(amplitude)
        if mixing is not None:
            lines = np.einsum("fij,jef->ief", mixing, lines * np.asarray(settings.levels)[:, None, None])
        periods = block_of(lines, layout.block_samples)
        for capture in captures:
            yield capture, periods[:, capture.experiment]
