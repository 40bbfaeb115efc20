"""Schedule of an experiment: blocks, delays, captures and lines."""

import math

import numpy as np
from numpy.typing import NDArray

from duralab_settings import ExcitationKind, SettingsError
from duralab_spectra import count_blocks, hann_periodic, hop_samples, independent_averages, line_frequencies
from identifier.excitation.hadamard import nearest_hadamard_order
from identifier.excitation.multisine import choose_lines
from identifier.excitation.orthogonal import experiments_of
from identifier.excitation.power_spectrum import power_density
from identifier.excitation.settings import ExperimentSettings
from identifier.layout import Capture, Layout, Window

AVERAGES_PER_DRIVE = 2
"""Independent averages needed for each random drive; with as many averages as drives S_uu may be singular."""

_DURATION, _FADE = "excitation.duration", "excitation.fade"


def schedule_experiment(settings: ExperimentSettings, *, drives: int, sample_rate: float) -> Layout:
    """Return the layout of an experiment in time and frequency.

    Parameters
    ----------
    settings
        Settings, valid when constructed.
    drives
        Number of drives of the rig, 1 or more.
    sample_rate
        Sample rate of the rig, in hertz.

    Returns
    -------
    Layout
        Layout of the drive that `design_experiment` makes.

    Raises
    ------
    SettingsError
        Levels, band, lines, fades or duration do not fit the rig or would not identify it.
    """
    _check_drives(settings, drives)
    excited, detection = _lines(settings, sample_rate)
    if settings.kind is ExcitationKind.PURE_RANDOM:
        captures, samples, fade = _pure_random(settings, drives, sample_rate)
    elif settings.kind.is_multisine:
        captures, samples, fade = _multisine(settings, drives, sample_rate)
    else:
        captures, samples, fade = _bursts(settings, drives, sample_rate)
    windowed = settings.kind is ExcitationKind.PURE_RANDOM
    return Layout(
        samples=samples,
        sample_rate=sample_rate,
        block_samples=settings.block_samples,
        fade_samples=fade,
        overlap=settings.overlap if windowed else 0.0,
        periodic=settings.kind.is_multisine,
        delay_blocks=settings.delay_blocks if settings.kind.is_multisine else 0,
        captures=captures,
        lowest=settings.spectra[0].lowest_frequency,
        highest=settings.spectra[0].highest_frequency,
        excited=excited,
        detection=detection,
        window=Window.HANN if windowed else Window.NONE,
    )


def averages_of(layout: Layout) -> tuple[int, float]:
    """Return the number of blocks of a layout, and of equivalent independent ones.

    `layout`: Layout of an experiment.
    Returns: Averaged blocks (Eq. 10), and equivalent independent ones with overlap and window taken into account. Of
    periodic excitations each capture counts once: its periods average noise, but hold the same distortion.
    """
    block = layout.block_samples
    counts = [count_blocks(layout.samples_of(capture), block, layout.overlap) for capture in layout.captures]
    if layout.window is Window.NONE:
        return sum(counts), float(len(counts) if layout.periodic else sum(counts))
    window, hop = hann_periodic(block), hop_samples(block, layout.overlap)
    return sum(counts), sum(independent_averages(window, hop, count) for count in counts)


def burst_samples(settings: ExperimentSettings) -> int:
    """Return the number of samples of a burst or sweep, including its fades."""
    return round(settings.burst_share * settings.block_samples)


def _check_drives(settings: ExperimentSettings, drives: int) -> None:
    if len(settings.levels) != drives:
        name = settings.level_kind.value
        raise SettingsError(
            f"{len(settings.levels)} values of {name} were given; the rig has {drives} drives and needs one for each.",
            field=f"excitation.{name}",
        )


def _lines(settings: ExperimentSettings, sample_rate: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    spectrum, block = settings.spectra[0], settings.block_samples
    if spectrum.highest_frequency >= sample_rate / 2.0:
        raise SettingsError(
            f"The band ends at {spectrum.highest_frequency:g} Hz; the rig samples at {sample_rate:g} Hz, so it must "
            f"end below {sample_rate / 2.0:g} Hz.",
            field="excitation.spectrum.highest_frequency",
        )
    frequency = line_frequencies(block, sample_rate)
    excited, detection = choose_lines(
        spectrum,
        frequency=frequency,
        odd=settings.odd_lines,
        detection_share=settings.detection_share,
        seed=settings.seed,
    )
    if not excited.any():
        raise SettingsError(
            f"Blocks of {block} samples have a line every {sample_rate / block:.4g} Hz and none to excite from "
            f"{spectrum.lowest_frequency:g} to {spectrum.highest_frequency:g} Hz; take longer blocks or a wider band.",
            field="estimator.block_samples",
        )
    if settings.detection_share > 0.0 and not np.any(detection[1::2] if settings.odd_lines else detection):
        raise SettingsError(
            f"A detection share of {settings.detection_share:g} leaves out none of {int(excited.sum())} lines; "
            "take a larger share, longer blocks or a wider band.",
            field="excitation.detection_share",
        )
    for index, shape in enumerate(settings.spectra):
        density = power_density(shape, frequency[excited])
        wrong = np.flatnonzero(~((density > 0.0) & (density < np.inf)))
        if wrong.size:
            raise SettingsError(
                f"The PSD of drive {index} is {density[wrong[0]]} at {frequency[excited][wrong[0]]:.4g} Hz, inside its "
                "band; it must be greater than 0 there, or the band must end before.",
                field="excitation.drive_spectra",
            )
    return excited, detection


def _pure_random(settings: ExperimentSettings, drives: int, sample_rate: float) -> tuple[tuple[Capture, ...], int, int]:
    block, samples, fade = settings.block_samples, settings.samples(sample_rate), settings.fade_samples(sample_rate)
    used = samples - 2 * fade
    blocks = count_blocks(used, block, settings.overlap)
    if blocks == 0:
        raise SettingsError(
            f"A block of {block} samples lasts {block / sample_rate:g} s; between the fades the excitation lasts only "
            f"{used / sample_rate:g} s, so take shorter blocks or a longer excitation.",
            field="estimator.block_samples",
        )
    window, hop, needed = hann_periodic(block), hop_samples(block, settings.overlap), AVERAGES_PER_DRIVE * drives
    averages = independent_averages(window, hop, blocks)
    if averages < needed:
        # A long record has the fewest independent averages per block, so its ratio is always sufficient.
        long_record = 10**9
        enough = math.ceil(needed * long_record / independent_averages(window, hop, long_record))
        least = ((enough - 1) * hop + block + 2 * fade) / sample_rate
        raise SettingsError(
            f"An excitation of {settings.duration:g} s gives {averages:.3g} independent averages; {needed} are "
            f"needed for {drives} drives, so take {math.ceil(least)} s or more, or shorter blocks.",
            field=_DURATION,
        )
    return (Capture(start=fade, periods=used // block, realisation=0, experiment=0),), samples, fade


def _bursts(settings: ExperimentSettings, drives: int, sample_rate: float) -> tuple[tuple[Capture, ...], int, int]:
    block, length, fade = settings.block_samples, burst_samples(settings), settings.fade_samples(sample_rate)
    if 2 * fade >= length:
        raise SettingsError(
            f"The fade lasts {settings.fade:g} s and each burst {length / sample_rate:g} s; take a fade "
            "shorter than half a burst.",
            field=_FADE,
        )
    blocks, sweeps = settings.samples(sample_rate) // block, settings.kind is ExcitationKind.SWEPT_SINE
    columns = nearest_hadamard_order(drives) if sweeps else 1
    needed = columns if sweeps else AVERAGES_PER_DRIVE * drives
    if blocks < needed:
        raise SettingsError(
            f"An excitation of {settings.duration:g} s holds {blocks} blocks of {block} samples; {needed} are "
            f"needed for {drives} drives, so take {math.ceil(needed * block / sample_rate)} s or more, or shorter "
            "blocks.",
            field=_DURATION,
        )
    blocks -= blocks % columns
    # A sweep played again is a repeat; a new burst is a new realisation.
    captures = tuple(
        Capture(
            start=index * block,
            periods=1,
            realisation=0 if sweeps else index,
            experiment=index % columns,
        )
        for index in range(blocks)
    )
    return captures, blocks * block, 0


def _multisine(settings: ExperimentSettings, drives: int, sample_rate: float) -> tuple[tuple[Capture, ...], int, int]:
    block, fade = settings.block_samples, settings.fade_samples(sample_rate)
    delay, used = settings.delay_blocks * block, settings.capture_blocks * block
    if fade > delay:
        raise SettingsError(
            f"The fade lasts {settings.fade:g} s and the delay before each capture {delay / sample_rate:g} s; "
            "take a shorter fade or more delay blocks.",
            field=_FADE,
        )
    columns = experiments_of(settings.kind, drives)
    realisation = settings.repeats * columns * (delay + used)
    fitting = (settings.samples(sample_rate) - fade) // realisation
    # Independent phases make S_uu regular only with at least as many draws as drives.
    least = drives if settings.kind is ExcitationKind.PSEUDO_RANDOM else 1
    wanted = max(fitting, 0) if settings.realisations is None else settings.realisations
    if wanted > fitting or wanted < least:
        asked = max(wanted, least)
        raise SettingsError(
            f"{asked} realisations of {realisation / block:g} blocks last "
            f"{(asked * realisation + fade) / sample_rate:g} s, fade included, of which the excitation's "
            f"{settings.duration:g} s hold {max(fitting, 0)}; {least} or more are needed for {drives} "
            "drives, so take a longer excitation, shorter blocks or fewer of them.",
            field=_DURATION if wanted > fitting or settings.realisations is None else "excitation.realisations",
        )
    order = [(number, column) for number in range(wanted) for _ in range(settings.repeats) for column in range(columns)]
    captures = tuple(
        Capture(
            start=index * (delay + used) + delay,
            periods=settings.capture_blocks,
            realisation=number,
            experiment=column,
        )
        for index, (number, column) in enumerate(order)
    )
    return captures, len(order) * (delay + used) + fade, fade
