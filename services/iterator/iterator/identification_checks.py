"""The identification part of a campaign's specification, checked against the rig."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from duralab_proto.arrays import from_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, rig_pb2
from iterator.rig_model import FEWEST_LINES
from labbus import FaultError

_SMALLEST_BLOCK: Final = 256


def invalid(message: str, *, field: str) -> FaultError:
    """Return the fault for a value of a specification that is not allowed."""
    return FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, message, field=field)


def check_excitation(spec: iterator_pb2.CampaignSpec, description: rig_pb2.RigDescription) -> None:
    """Refuse an excitation that the rig cannot play.

    Parameters
    ----------
    spec : CampaignSpec
        As received.
    description : RigDescription
        Of its rig.

    Raises
    ------
    FaultError
        INVALID_ARGUMENT with the field.
    ArrayError
        The array of levels is damaged.
    """
    excitation = spec.excitation
    if excitation.kind != identifier_pb2.EXCITATION_KIND_PURE_RANDOM:
        raise invalid(
            f"The kind of excitation is {excitation.kind}; only PURE_RANDOM "
            f"({identifier_pb2.EXCITATION_KIND_PURE_RANDOM}) is offered.",
            field="excitation.kind",
        )
    nyquist = description.sample_rate / 2.0
    spectrum = excitation.spectrum
    lowest, highest = spectrum.lowest_frequency, spectrum.highest_frequency
    if not 0.0 < lowest < highest < nyquist:
        raise invalid(
            f"The excitation's band is {lowest:g} to {highest:g} Hz; it must lie above 0 and below half the "
            f"sample rate, {nyquist:g} Hz.",
            field="excitation.spectrum.highest_frequency" if highest >= nyquist else "excitation.spectrum",
        )
    if not lowest <= spectrum.corner_frequency <= highest:
        raise invalid(
            f"The excitation's corner is at {spectrum.corner_frequency:g} Hz; it must lie in its band of {lowest:g} to "
            f"{highest:g} Hz.",
            field="excitation.spectrum.corner_frequency",
        )
    if not 0.0 <= spectrum.decibels_per_octave < math.inf:
        raise invalid(
            f"The excitation falls by {spectrum.decibels_per_octave:g} dB per octave; it must be finite and 0 or more.",
            field="excitation.spectrum.decibels_per_octave",
        )
    _check_levels(excitation, description)
    duration, fade = excitation.duration_seconds, excitation.fade_seconds
    if not 0.0 < duration <= description.longest_drive_seconds:
        raise invalid(
            f"The excitation lasts {duration:g} s; it must be above 0 and at most "
            f"{description.longest_drive_seconds:g} s, the longest drive of rig {description.rig!r}.",
            field="excitation.duration_seconds",
        )
    if not 0.0 <= fade < duration / 2.0:
        raise invalid(
            f"The excitation fades for {fade:g} s; it must be 0 or more and less than half of its {duration:g} s.",
            field="excitation.fade_seconds",
        )
    if excitation.seed not in (0, spec.seed):
        raise invalid(
            f"The excitation's seed is {excitation.seed}; leave it 0, every seed comes from the campaign's own.",
            field="excitation.seed",
        )


def _check_levels(excitation: identifier_pb2.Excitation, description: rig_pb2.RigDescription) -> None:
    levels = from_array(excitation.rms, field="excitation.rms", shape=(None,), dtype=np.float64)
    if levels.size != len(description.drives):
        raise invalid(
            f"The excitation has {levels.size} RMS values; each of the {len(description.drives)} drives of rig "
            f"{description.rig!r} needs one.",
            field="excitation.rms",
        )
    for channel, level in zip(description.drives, levels, strict=True):
        if not level > 0.0:
            raise invalid(
                f"The excitation's RMS of {channel.name} is {level:g} {channel.unit}; it must be greater than 0.",
                field="excitation.rms",
            )


def check_estimator(spec: iterator_pb2.CampaignSpec, description: rig_pb2.RigDescription) -> None:
    """Refuse an estimator that does not fit the excitation, which is checked already.

    Parameters
    ----------
    spec : CampaignSpec
        As received.
    description : RigDescription
        Of its rig.

    Raises
    ------
    FaultError
        INVALID_ARGUMENT with the field.
    """
    estimator, excitation = spec.estimator, spec.excitation
    if estimator.kind != identifier_pb2.ESTIMATOR_KIND_H1:
        raise invalid(
            f"The kind of estimator is {estimator.kind}; only H1 ({identifier_pb2.ESTIMATOR_KIND_H1}) is offered.",
            field="estimator.kind",
        )
    block = estimator.block_samples
    if block < _SMALLEST_BLOCK or block % 2 != 0:
        raise invalid(
            f"The estimator's block has {block} samples; it must be even and {_SMALLEST_BLOCK} or more.",
            field="estimator.block_samples",
        )
    if not 0.0 <= estimator.overlap < 1.0:
        raise invalid(
            f"The estimator's overlap is {estimator.overlap:g}; it must be 0 or more and less than 1.",
            field="estimator.overlap",
        )
    used = int((excitation.duration_seconds - 2.0 * excitation.fade_seconds) * description.sample_rate)
    if block > used:
        raise invalid(
            f"The estimator's block has {block} samples; the excitation has {used} between its fades: take shorter "
            "blocks or a longer excitation.",
            field="estimator.block_samples",
        )
    spacing = description.sample_rate / block
    width = excitation.spectrum.highest_frequency - excitation.spectrum.lowest_frequency
    if math.floor(width / spacing) < FEWEST_LINES:
        raise invalid(
            f"Blocks of {block} samples have lines {spacing:g} Hz apart, too far for the excitation's band of "
            f"{width:g} Hz; at least {FEWEST_LINES} must fit: take longer blocks.",
            field="estimator.block_samples",
        )
