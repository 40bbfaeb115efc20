"""Plan of an experiment: duration and results, known before anything moves."""

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
        Of the whole drive.
    realisations
        Sets of independent phases; 1 where the excitation is not periodic.
    experiments_per_realisation
        Columns of the decorrelation matrix; where the excitation is not periodic, its uninterrupted stretches.
    periods
        Used of each experiment each time it is played; 0 where the excitation is not periodic.
    delay_seconds_share
        Share of the duration that is played but not used, delays and fades, 0 to 1.
    blocks
        Averaged.
    independent_averages
        Equivalent independent blocks, overlap and window accounted for; of multisines each capture counts once, however
        many periods it has, since they hold the same distortion.
    frequency_resolution
        Distance of neighbouring lines, in hertz.
    lines
        Number of lines that are excited.
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
    """Say what an experiment takes and gives, without making its drive.

    Parameters
    ----------
    settings
        Valid when constructed.
    drives
        Of the rig, 1 or more.
    sample_rate
        Of the rig, in hertz.

    Returns
    -------
    ExperimentPlan
        Of the drive that `design_experiment` makes.

    Raises
    ------
    SettingsError
        Where the settings do not fit the rig.
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
    """Time after which the transient of a mode has died out.

    Parameters
    ----------
    natural_frequency
        Of the mode that dies out slowest, in hertz, greater than 0.
    damping_ratio
        Of that mode, above 0 and below 1.
    remainder
        Share of the transient that may be left, above 0 and below 1.

    Returns
    -------
    float
        ``ln(1 / remainder) / (zeta omega_n)``, in seconds: what the delay blocks must last at least.

    Raises
    ------
    ValueError
        Where a value is not allowed.
    """
    if not (0.0 < natural_frequency < math.inf and 0.0 < damping_ratio < 1.0 and 0.0 < remainder < 1.0):
        raise ValueError(
            f"A mode at {natural_frequency} Hz with a damping ratio of {damping_ratio} and a remainder of {remainder}; "
            "the frequency must be above 0, the others above 0 and below 1."
        )
    return math.log(1.0 / remainder) / (damping_ratio * 2.0 * math.pi * natural_frequency)
