"""Rig of an experiment, the check of the experiment against it, and the drive within its limits."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from duralab_proto.v1 import array_pb2, rig_pb2
from duralab_settings import EstimatorKind, ExcitationKind, LevelKind, SettingsError
from duralab_spectra import count_blocks
from identifier.estimators import Estimation, EstimatorOptions
from identifier.excitation import Experiment, ExperimentSettings, check_levels, design_experiment, schedule_experiment
from identifier.experiment.settings import IdentificationSettings
from identifier.experiment.static_gain import static_samples, with_static_steps

LARGEST_AVERAGED_SAMPLES = 2**28
"""Largest product of blocks and samples of a block: about half a minute of transforms."""


@dataclass(frozen=True)
class RigUnderTest:
    """Properties of a rig that the identifier uses.

    Parameters
    ----------
    name
        Name as in its keys.
    sample_rate
        Sample rate that it plays, in hertz.
    drives, responses
        Channels in the rig's order.
    longest_drive_seconds
        Longest drive, in seconds.
    content_hash
        Hash of everything that determines its response.
    """

    name: str
    sample_rate: float
    drives: tuple[array_pb2.Channel, ...]
    responses: tuple[array_pb2.Channel, ...]
    longest_drive_seconds: float
    content_hash: str

    @classmethod
    def from_message(cls, description: rig_pb2.RigDescription) -> "RigUnderTest":
        """Return the needed properties from a rig's description.

        Parameters
        ----------
        description
            Description as the rig answered it.

        Returns
        -------
        RigUnderTest
            Properties as a value.

        Raises
        ------
        ValueError
            The description cannot be used.
        """
        if not (np.isfinite(description.sample_rate) and description.sample_rate > 0.0):
            raise ValueError(
                f"Rig {description.rig!r} describes itself with {description.sample_rate} samples per second; "
                "a rig needs a rate greater than 0."
            )
        if not description.drives or len(description.responses) < len(description.drives):
            raise ValueError(
                f"Rig {description.rig!r} has {len(description.drives)} drives and {len(description.responses)} "
                "responses; identification needs a drive and at least as many responses as drives."
            )
        return cls(
            name=description.rig,
            sample_rate=description.sample_rate,
            drives=tuple(description.drives),
            responses=tuple(description.responses),
            longest_drive_seconds=description.longest_drive_seconds,
            content_hash=description.content_hash,
        )


def with_names(sentence: str, rig: RigUnderTest) -> str:
    """Replace the numbers of channels in a sentence, which estimators use, by their names.

    `sentence`: Sentence of an estimator, e.g. "response 1 stays at 0". `rig`: Rig with the channels.
    Returns: The sentence with names.
    """

    def name(match: re.Match[str]) -> str:
        channels = rig.drives if match["kind"].lower().startswith("drive") else rig.responses
        return match["kind"] + re.sub(r"\d+", lambda number: channels[int(number[0])].name, match["numbers"])

    return re.sub(r"\b(?P<kind>[Rr]esponse|[Dd]rive|[Dd]rives)(?P<numbers> \d+\b(?: and \d+\b)?)", name, sentence)


def check_against_rig(settings: IdentificationSettings, rig: RigUnderTest) -> None:
    """Refuse an experiment that a rig cannot play or that would not identify it.

    Parameters
    ----------
    settings
        Settings, valid when constructed.
    rig
        Rig of the experiment.

    Raises
    ------
    SettingsError
        The number of levels, the duration, the blocks or the estimator do not fit the rig. Errors of the excitation
        alone (lines, averages, realisations) are found by `schedule_experiment`.
    """
    excitation = settings.excitation
    if len(excitation.levels) != len(rig.drives):
        name = "RMS" if excitation.level_kind is LevelKind.RMS else "peak"
        raise SettingsError(
            f"{len(excitation.levels)} {name} values were given; rig {rig.name!r} has {len(rig.drives)} drives "
            f"({_names(rig.drives)}) and needs one for each.",
            field=f"excitation.{excitation.level_kind.value}",
        )
    holds = static_samples(excitation, drives=len(rig.drives), sample_rate=rig.sample_rate) / rig.sample_rate
    if excitation.duration + holds > rig.longest_drive_seconds:
        with_holds = f", and its static holds {holds:g} s" if holds else ""
        raise SettingsError(
            f"The excitation lasts {excitation.duration:g} s{with_holds}; rig {rig.name!r} plays at most "
            f"{rig.longest_drive_seconds:g} s.",
            field="excitation.duration",
        )
    if settings.response_weight is not None and len(settings.response_weight) != len(rig.responses):
        raise SettingsError(
            f"{len(settings.response_weight)} weights of responses were given; rig {rig.name!r} has "
            f"{len(rig.responses)} responses and needs one for each.",
            field="drive_map.response_weight",
        )
    _check_blocks(excitation, rig.sample_rate)
    if settings.estimator.kind is EstimatorKind.H2 and len(rig.responses) != len(rig.drives):
        raise SettingsError(
            f"Rig {rig.name!r} has {len(rig.responses)} responses and {len(rig.drives)} drives; H2 needs as many of "
            "both: take H1 or Hv.",
            field="estimator.kind",
        )
    layout = schedule_experiment(excitation, drives=len(rig.drives), sample_rate=rig.sample_rate)
    estimator = settings.estimator
    options = EstimatorOptions(order=estimator.local_order, half_width=estimator.local_half_width)
    try:
        Estimation(estimator.kind, layout, drives=len(rig.drives), responses=len(rig.responses), options=options)
    except ValueError as error:
        raise SettingsError(str(error), field="estimator.local_half_width") from error


def make_experiment(settings: ExperimentSettings, rig: RigUnderTest) -> Experiment:
    """Make the drive of an experiment and check it against the rig's limits.

    Parameters
    ----------
    settings
        Settings checked against the rig, see `check_against_rig`.
    rig
        Rig of the experiment.

    Returns
    -------
    Experiment
        Drive and layout; if the static gain is measured, its holds follow the layout's samples.

    Raises
    ------
    SettingsError
        A drive would exceed a limit.
    """
    experiment = design_experiment(settings, drives=len(rig.drives), sample_rate=rig.sample_rate)
    drive = with_static_steps(experiment.drive, settings, sample_rate=rig.sample_rate)
    check_levels(
        drive,
        channels=rig.drives,
        levels=settings.levels,
        sample_rate=rig.sample_rate,
        level_kind=settings.level_kind,
    )
    return replace(experiment, drive=drive)


def _check_blocks(excitation: ExperimentSettings, sample_rate: float) -> None:
    """Refuse blocks longer than the record before their lines are counted, and more blocks than can be averaged."""
    block = excitation.block_samples
    used = excitation.samples(sample_rate) - 2 * excitation.fade_samples(sample_rate)
    if block > used:
        raise SettingsError(
            f"A block of {block} samples lasts {block / sample_rate:g} s; between the fades the excitation lasts only "
            f"{used / sample_rate:g} s, so take shorter blocks or a longer excitation.",
            field="estimator.block_samples",
        )
    if excitation.kind is not ExcitationKind.PURE_RANDOM:
        return
    blocks = count_blocks(used, block, excitation.overlap)
    if blocks * block > LARGEST_AVERAGED_SAMPLES:
        raise SettingsError(
            f"An overlap of {excitation.overlap:g} cuts the record into {blocks} blocks of {block} samples; at most "
            f"{LARGEST_AVERAGED_SAMPLES // block} such blocks are averaged, so take a smaller overlap.",
            field="estimator.overlap",
        )


def _names(channels: Sequence[array_pb2.Channel]) -> str:
    return ", ".join(channel.name for channel in channels)
