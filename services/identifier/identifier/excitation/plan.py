"""Plan of an experiment: duration and results, known before any motion."""

import math
from dataclasses import dataclass

from identifier.excitation.schedule import averages_of, schedule_experiment
from identifier.excitation.settings import ExperimentSettings


@dataclass(frozen=True)
class ExperimentPlan:
    """Plan of an experiment.

    Parameters
    ----------
    duration_seconds, samples
        Duration in seconds and number of samples of the whole drive.
    realisations
        Number of sets of independent phases; 1 if the excitation is not periodic.
    experiments_per_realisation
        Number of columns of the decorrelation matrix; if the excitation is not periodic, of its captures.
    periods
        Number of used periods of each experiment each time it is played; 0 if the excitation is not periodic.
    delay_seconds_share
        Share of the duration that is played but not used (delays and fades), 0 to 1.
    blocks
        Number of averaged blocks.
    independent_averages
        Equivalent independent blocks, with overlap and window taken into account; for multisines each capture counts
        once, for any number of periods, because they hold the same distortion.
    frequency_resolution
        Distance of neighbouring lines, in hertz.
    lines
        Number of excited lines.
    """

    duration_seconds: float
    samples: int
    realisations: int
    experiments_per_realisation: int
    periods: int
    delay_seconds_share: float
    blocks: int
    independent_averages: float
    frequency_resolution: float
    lines: int


def plan_experiment(settings: ExperimentSettings, *, drives: int, sample_rate: float) -> ExperimentPlan:
    """Return duration and results of an experiment, without making its drive.

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
    ExperimentPlan
        Plan of the drive that `design_experiment` makes.

    Raises
    ------
    SettingsError
        The settings do not fit the rig.
    """
    layout = schedule_experiment(settings, drives=drives, sample_rate=sample_rate)
    blocks, independent = averages_of(layout)
    used = sum(layout.samples_of(capture) for capture in layout.captures)
    sets = {capture.realisation for capture in layout.captures}
    columns = {capture.experiment for capture in layout.captures}
    return ExperimentPlan(
        duration_seconds=layout.samples / sample_rate,
        samples=layout.samples,
        realisations=len(sets) if layout.periodic else 1,
        experiments_per_realisation=len(columns) if layout.periodic else len(layout.captures),
        periods=layout.captures[0].periods if layout.periodic else 0,
        delay_seconds_share=1.0 - used / layout.samples,
        blocks=blocks,
        independent_averages=independent,
        frequency_resolution=sample_rate / layout.block_samples,
        lines=int(layout.excited.sum()),
    )


def shortest_delay_seconds(*, natural_frequency: float, damping_ratio: float, remainder: float) -> float:
    """Return the time after which the transient of a mode has decayed.

    Parameters
    ----------
    natural_frequency
        Frequency of the mode with the slowest decay, in hertz, greater than 0.
    damping_ratio
        Damping ratio of that mode, above 0 and below 1.
    remainder
        Share of the transient that may remain, above 0 and below 1.

    Returns
    -------
    float
        ``ln(1 / remainder) / (zeta omega_n)``, in seconds: shortest duration of the delay blocks.

    Raises
    ------
    ValueError
        A value is not allowed.
    """
    if not (0.0 < natural_frequency < math.inf and 0.0 < damping_ratio < 1.0 and 0.0 < remainder < 1.0):
        raise ValueError(
            f"A mode at {natural_frequency} Hz with a damping ratio of {damping_ratio} and a remainder of {remainder}; "
            "the frequency must be above 0, the others above 0 and below 1."
        )
    return math.log(1.0 / remainder) / (damping_ratio * 2.0 * math.pi * natural_frequency)
