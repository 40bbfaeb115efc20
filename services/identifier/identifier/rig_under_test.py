"""The rig an experiment is for, and whether the experiment fits it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from duralab_proto.v1 import array_pb2, rig_pb2
from identifier.settings import ExperimentSettings, SettingError
from spectra import count_blocks, hann_periodic, hop_samples, independent_averages, line_frequencies

AVERAGES_PER_DRIVE = 2
"""Independent averages needed for each drive; with as many averages as drives S_uu is singular by chance alone."""

LARGEST_AVERAGED_SAMPLES = 2**28
"""Blocks times samples of a block: about half a minute of transforms."""


@dataclass(frozen=True)
class RigUnderTest:
    """What the identifier needs to know of a rig.

    Parameters
    ----------
    name
        As in its keys.
    sample_rate
        The only one it plays, in hertz.
    drives, responses
        Channels in the rig's order.
    longest_drive_seconds
        Longest drive it plays.
    content_hash
        Of everything that decides what it answers.
    """

    name: str
    sample_rate: float
    drives: tuple[array_pb2.Channel, ...]
    responses: tuple[array_pb2.Channel, ...]
    longest_drive_seconds: float
    content_hash: str

    @classmethod
    def from_message(cls, description: rig_pb2.RigDescription) -> "RigUnderTest":
        """Take what is needed from a rig's description.

        Parameters
        ----------
        description
            As the rig answered it.

        Returns
        -------
        RigUnderTest
            The same, as a value.

        Raises
        ------
        ValueError
            Where the description cannot be worked with.
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


def check_against_rig(settings: ExperimentSettings, rig: RigUnderTest) -> None:
    """Refuse an experiment that a rig cannot play or that would not identify it.

    Parameters
    ----------
    settings
        Sound by themselves.
    rig
        What it is for.

    Raises
    ------
    SettingError
        Where the number of RMS values, the band, the duration, the block or the overlap does not fit the rig.
    """
    if len(settings.rms) != len(rig.drives):
        raise SettingError(
            f"{len(settings.rms)} RMS values were given; rig {rig.name!r} has {len(rig.drives)} drives "
            f"({_names(rig.drives)}) and needs one for each.",
            field="excitation.rms",
        )
    nyquist = rig.sample_rate / 2.0
    if settings.spectrum.highest_frequency >= nyquist:
        raise SettingError(
            f"The band ends at {settings.spectrum.highest_frequency:g} Hz; rig {rig.name!r} samples at "
            f"{rig.sample_rate:g} Hz, so it must end below {nyquist:g} Hz.",
            field="excitation.spectrum.highest_frequency",
        )
    if settings.duration_seconds > rig.longest_drive_seconds:
        raise SettingError(
            f"The excitation lasts {settings.duration_seconds:g} s; rig {rig.name!r} plays at most "
            f"{rig.longest_drive_seconds:g} s.",
            field="excitation.duration_seconds",
        )
    # The number of averages first: it refuses blocks longer than the record before their lines are counted.
    _check_averages(settings, rig)
    _check_lines(settings, rig.sample_rate)


def _check_lines(settings: ExperimentSettings, sample_rate: float) -> None:
    spectrum = settings.spectrum
    if not spectrum.contains(line_frequencies(settings.block_samples, sample_rate)).any():
        raise SettingError(
            f"Blocks of {settings.block_samples} samples have a line every {sample_rate / settings.block_samples:.4g} "
            f"Hz and none in the band from {spectrum.lowest_frequency:g} to {spectrum.highest_frequency:g} Hz; "
            "take longer blocks or a wider band.",
            field="estimator.block_samples",
        )


def _check_averages(settings: ExperimentSettings, rig: RigUnderTest) -> None:
    rate, block, overlap = rig.sample_rate, settings.block_samples, settings.overlap
    used = settings.samples(rate) - 2 * settings.fade_samples(rate)
    blocks = count_blocks(used, block, overlap)
    if blocks == 0:
        raise SettingError(
            f"A block of {block} samples lasts {block / rate:g} s; between the fades the excitation lasts only "
            f"{used / rate:g} s, so take shorter blocks or a longer excitation.",
            field="estimator.block_samples",
        )
    if blocks * block > LARGEST_AVERAGED_SAMPLES:
        raise SettingError(
            f"An overlap of {overlap:g} cuts the record into {blocks} blocks of {block} samples; at most "
            f"{LARGEST_AVERAGED_SAMPLES // block} such blocks are averaged, so take a smaller overlap.",
            field="estimator.overlap",
        )
    window, hop = hann_periodic(block), hop_samples(block, overlap)
    needed = AVERAGES_PER_DRIVE * len(rig.drives)
    averages = independent_averages(window, hop, blocks)
    if averages < needed:
        # A long record holds the fewest independent averages per block, so its ratio is always enough.
        long_record = 10**9
        enough = math.ceil(needed * long_record / independent_averages(window, hop, long_record))
        least = ((enough - 1) * hop + block) / rate + 2.0 * settings.fade_seconds
        raise SettingError(
            f"An excitation of {settings.duration_seconds:g} s gives {averages:.3g} independent averages; {needed} are "
            f"needed for {len(rig.drives)} drives, so take {math.ceil(least)} s or more, or shorter blocks.",
            field="excitation.duration_seconds",
        )


def _names(channels: Sequence[array_pb2.Channel]) -> str:
    return ", ".join(channel.name for channel in channels)
