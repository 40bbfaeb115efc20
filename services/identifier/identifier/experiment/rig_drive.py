"""The experiment for a rig, checked against its limits."""

from identifier.excitation import ExcitationSettings, Experiment, check_levels, design_experiment
from identifier.experiment.rig_under_test import RigUnderTest


def make_experiment(settings: ExcitationSettings, rig: RigUnderTest) -> Experiment:
    """Make the drive of an experiment and check it against the rig's limits.

    Parameters
    ----------
    settings
        Checked against the rig, see `check_against_rig`.
    rig
        What it is for.

    Returns
    -------
    Experiment
        Drive and layout.

    Raises
    ------
    SettingError
        Where a drive would pass a limit.
    """
    experiment = design_experiment(settings, drives=len(rig.drives), sample_rate=rig.sample_rate)
    check_levels(
        experiment.drive,
        channels=rig.drives,
        levels=settings.levels,
        sample_rate=rig.sample_rate,
        level_kind=settings.level_kind,
    )
    return experiment
