"""From a campaign file, a rig and a target to the `CampaignSpec` that the iterator runs."""

from __future__ import annotations

import numpy as np

from duralab.campaign_file import Algorithm, Campaign
from duralab.errors import InputError
from duralab.rig import Rig
from duralab.signals import Channel, Signals
from duralab_proto.arrays import to_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2

_UPDATES = {
    Algorithm.ADAPTIVE_MODELLING: iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING,
    Algorithm.BASIC_TWR: iterator_pb2.UPDATE_KIND_BASIC_TWR,
}

GAUSSIAN_CREST = 3.0
"""Noise passes this multiple of its RMS often enough that a drive which leaves no room for it is refused at once."""


def check_against_rig(campaign: Campaign, rig: Rig) -> None:
    """Check everything of a campaign that depends on the rig, before anything is played.

    Raises
    ------
    InputError
        A band above half the sample rate, an unknown channel, a level beyond a limit, or a drive that is too long.
    """
    excitation, nyquist = campaign.excitation, rig.sample_rate / 2
    if excitation.highest_frequency >= nyquist:
        raise InputError(
            f"excitation.highest_frequency is {excitation.highest_frequency:g} Hz; it must be below {nyquist:g} Hz, "
            f"half the sample rate of rig {rig.name!r}.",
            field="excitation.highest_frequency",
        )
    rms = per_channel(excitation.rms, rig.drives, key="excitation.rms")
    for channel, level in zip(rig.drives, rms, strict=True):
        room = min(-channel.minimum, channel.maximum)
        if GAUSSIAN_CREST * level > room:
            raise InputError(
                f"excitation.rms of {channel.name} is {level:g} {channel.unit}; the drive's limit of {room:g} "
                f"{channel.unit} leaves room for {room / GAUSSIAN_CREST:g} {channel.unit} RMS.",
                field="excitation.rms",
            )
    per_channel(campaign.update.gain, rig.responses, key="update.gain")
    source = campaign.target.road or campaign.target.opencrg
    for key, seconds in (
        ("excitation.duration", excitation.duration),
        ("target duration", source.duration if source else 0.0),
    ):
        if seconds > rig.longest_drive_seconds:
            raise InputError(
                f"{key} is {seconds:g} s; rig {rig.name!r} plays {rig.longest_drive_seconds:g} s at most.", field=key
            )
    block_seconds = campaign.estimator.block_samples / rig.sample_rate
    if block_seconds > excitation.duration - 2 * excitation.fade:
        raise InputError(
            f"estimator.block_samples is {campaign.estimator.block_samples} ({block_seconds:g} s); the experiment "
            f"without its fades lasts only {excitation.duration - 2 * excitation.fade:g} s.",
            field="estimator.block_samples",
        )


def per_channel(value: float | dict[str, float], channels: tuple[Channel, ...], *, key: str) -> np.ndarray:
    """Return a value for each channel, in order, from one number or a mapping by name; shape (channels)."""
    names = [channel.name for channel in channels]
    if not isinstance(value, dict):
        return np.full(len(names), float(value))
    unknown, missing = [name for name in value if name not in names], [name for name in names if name not in value]
    if unknown or missing:
        found = [f"unknown channel {', '.join(unknown)}"] if unknown else []
        found += [f"no value for {', '.join(missing)}"] if missing else []
        raise InputError(f"{key} has {' and '.join(found)}; it needs one for each of {', '.join(names)}.", field=key)
    return np.array([float(value[name]) for name in names])


def build_specification(
    campaign: Campaign, *, id: str, rig: Rig, target: Signals, source: str
) -> iterator_pb2.CampaignSpec:
    """Put a campaign into the words of the contract.

    Parameters
    ----------
    campaign : Campaign
        What the user wrote.
    id : str
        Name of the campaign in the lab.
    rig : Rig
        The rig that reproduces the target.
    target : Signals
        All responses of the rig, in its order and at its sample rate.
    source : str
        Where the target comes from, in words.
    """
    excitation, estimator, update, stop = campaign.excitation, campaign.estimator, campaign.update, campaign.stop
    return iterator_pb2.CampaignSpec(
        id=id,
        rig=rig.name,
        target=target.to_message(),
        target_source=source,
        excitation=identifier_pb2.Excitation(
            kind=identifier_pb2.EXCITATION_KIND_PURE_RANDOM,
            spectrum=identifier_pb2.WhitePinkSpectrum(
                lowest_frequency=excitation.lowest_frequency,
                highest_frequency=excitation.highest_frequency,
                corner_frequency=excitation.corner_frequency,
                decibels_per_octave=excitation.decibels_per_octave,
            ),
            rms=to_array(per_channel(excitation.rms, rig.drives, key="excitation.rms")),
            duration_seconds=excitation.duration,
            fade_seconds=excitation.fade,
            seed=campaign.seed,
        ),
        estimator=identifier_pb2.Estimator(
            kind=identifier_pb2.ESTIMATOR_KIND_H1,
            block_samples=estimator.block_samples,
            overlap=estimator.overlap,
        ),
        update=iterator_pb2.UpdateSettings(
            kind=_UPDATES[update.algorithm],
            iteration_gain=to_array(per_channel(update.gain, rig.responses, key="update.gain")),
            smallest_correction=update.smallest_correction,
            largest_correction=update.largest_correction,
            weigh_by_coherence=update.weigh_by_coherence,
            lowest_coherence=update.lowest_coherence,
        ),
        stop=iterator_pb2.StopCriteria(
            largest_iterations=stop.iterations,
            relative_rms_error=stop.relative_rms_error,
            divergence_ratio=stop.divergence_ratio,
        ),
        lowest_frequency=campaign.control_band.lowest_frequency,
        highest_frequency=campaign.control_band.highest_frequency,
        seed=campaign.seed,
        scenario=campaign.text,
    )
