"""Conversion of a campaign file, a rig and a target to the `CampaignSpec` that the iterator runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from duralab.campaign.file import Campaign
from duralab.campaign.loading import as_input_error
from duralab.data import Channel, Rig, Signals
from duralab.errors import InputError
from duralab_proto.v1 import identifier_pb2, iterator_pb2
from duralab_settings import (
    Acceptance,
    EstimatorSettings,
    ExcitationKind,
    ExcitationSettings,
    PlaybackSettings,
    SettingsError,
    StopCriteria,
    UpdateSection,
    per_channel,
)
from duralab_settings.messages import fill_message

GAUSSIAN_CREST = 3.0
"""Crest factor that noise and random phases often reach; a drive without room for it is refused."""


def check_against_rig(campaign: Campaign, rig: Rig) -> None:
    """Check all settings of a campaign that depend on the rig, before anything is played.

    `campaign`: Campaign to check. `rig`: Rig that will play it.
    Raises `InputError`: A band above half the sample rate, an unknown channel, a level beyond a limit, or a drive that
    is too long.
    """
    excitation, nyquist = campaign.excitation, rig.sample_rate / 2
    if excitation.highest_frequency >= nyquist:
        raise InputError(
            f"excitation.highest_frequency is {excitation.highest_frequency:g} Hz; it must be below {nyquist:g} Hz, "
            f"half the sample rate of rig {rig.name!r}.",
            field="excitation.highest_frequency",
        )
    name, given = excitation.levels
    with _fitting():
        levels = per_channel(given, _names(rig.drives), key=f"excitation.{name}")
        excitation.require_drives(_names(rig.drives))
        campaign.update.resolved(_names(rig.responses), drives=len(rig.drives))
    # A peak level is already the largest magnitude; sweeps and optimised phases have a crest factor near 1.
    near_rms = excitation.minimise_crest_factor or excitation.kind is ExcitationKind.SWEPT_SINE
    crest = 1.0 if name == "peak" or near_rms else GAUSSIAN_CREST
    for channel, level in zip(rig.drives, levels, strict=True):
        room = min(-channel.minimum, channel.maximum)
        if crest * level > room:
            raise InputError(
                f"excitation.{name} of {channel.name} is {level:g} {channel.unit}; the drive's limit of {room:g} "
                f"{channel.unit} leaves room for {room / crest:g} {channel.unit} {name.replace('rms', 'RMS')}.",
                field=f"excitation.{name}",
            )
    source = campaign.target.road or campaign.target.opencrg
    for key, seconds in (
        ("excitation.duration", excitation.duration),
        ("excitation.at_target.duration", 0.0 if excitation.at_target is None else excitation.at_target.duration),
        ("target duration", source.duration if source else 0.0),
    ):
        if seconds > rig.longest_drive_seconds:
            raise InputError(
                f"{key} is {seconds:g} s; rig {rig.name!r} plays {rig.longest_drive_seconds:g} s at most, so shorten "
                "it.",
                field=key,
            )
    block_seconds = campaign.estimator.block_samples / rig.sample_rate
    if block_seconds > excitation.duration - 2 * excitation.fade:
        raise InputError(
            f"estimator.block_samples is {campaign.estimator.block_samples} ({block_seconds:g} s); the experiment "
            f"without its fades lasts only {excitation.duration - 2 * excitation.fade:g} s, so give smaller blocks or "
            "a longer experiment.",
            field="estimator.block_samples",
        )


@contextmanager
def _fitting() -> Iterator[None]:
    """Raise InputError for settings that do not fit a rig's channels."""
    try:
        yield
    except SettingsError as error:
        raise as_input_error(error) from error


def _names(channels: tuple[Channel, ...]) -> list[str]:
    return [channel.name for channel in channels]


def acceptance_message(accept: Acceptance) -> iterator_pb2.Acceptance:
    """Convert the acceptance limits to their message.

    `accept`: Acceptance section of the campaign file.
    Returns: Message without the limits that are not judged.
    """
    message = iterator_pb2.Acceptance()
    fill_message(message, accept)
    return message


def excitation_message(excitation: ExcitationSettings, *, rig: Rig, seed: int) -> identifier_pb2.Excitation:
    """Convert the excitation to its message.

    `excitation`: Excitation section of the campaign file. `rig`: Rig to identify. `seed`: Seed of the random parts.
    Returns: Settings for the identifier.
    Raises `InputError`: A level or a spectrum is that of an unknown drive, or a level is missing.
    """
    message = identifier_pb2.Excitation()
    with _fitting():
        fill_message(message, excitation.resolved(_names(rig.drives), seed=seed))
    return message


def estimator_message(estimator: EstimatorSettings) -> identifier_pb2.Estimator:
    """Convert the estimator to its message.

    `estimator`: Settings of the estimator.
    Returns: Settings for the identifier.
    """
    message = identifier_pb2.Estimator()
    fill_message(message, estimator)
    return message


def update_message(update: UpdateSection, *, rig: Rig) -> iterator_pb2.UpdateSettings:
    """Convert the update to its message.

    `update`: Settings of the update. `rig`: Rig whose responses have the gains and weights.
    Returns: Settings for the iterator.
    """
    message = iterator_pb2.UpdateSettings()
    with _fitting():
        fill_message(message, update.resolved(_names(rig.responses), drives=len(rig.drives)))
    return message


def stop_message(stop: StopCriteria) -> iterator_pb2.StopCriteria:
    """Convert the stop criteria to their message.

    `stop`: Stop criteria of a campaign file.
    Returns: Criteria for the iterator.
    """
    message = iterator_pb2.StopCriteria()
    fill_message(message, stop)
    return message


def build_specification(
    campaign: Campaign, *, id: str, rig: Rig, target: Signals, source: str
) -> iterator_pb2.CampaignSpec:
    """Convert a campaign to its message.

    `campaign`: Campaign file. `id`: Name of the campaign in the lab. `rig`: Rig that reproduces the target. `target`:
    All responses of the rig, in its order and at its sample rate. `source`: Source of the target, as text.
    Returns: Specification for the iterator.
    """
    specification = iterator_pb2.CampaignSpec(
        id=id,
        rig=rig.name,
        target=target.to_message(),
        target_source=source,
        excitation=excitation_message(campaign.excitation, rig=rig, seed=campaign.seed),
        estimator=estimator_message(campaign.estimator),
        update=update_message(campaign.update, rig=rig),
        stop=stop_message(campaign.stop),
        accept=acceptance_message(campaign.accept),
        seed=campaign.seed,
        scenario=campaign.text,
    )
    fill_message(specification, campaign.control_band)
    if campaign.excitation.at_target is not None:
        fill_message(specification.at_target, campaign.excitation.at_target)
    if campaign.hold is not None:
        fill_message(specification.hold, campaign.hold)
    fill_message(specification, campaign, model=PlaybackSettings)
    return specification
