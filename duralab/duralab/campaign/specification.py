"""From a campaign file, a rig and a target to the `CampaignSpec` that the iterator runs."""

from __future__ import annotations

import numpy as np

from duralab.campaign.file import Acceptance, Campaign
from duralab.campaign.identification import EstimatorSettings, ExcitationKind, ExcitationSettings
from duralab.campaign.iteration import Algorithm, StopSection, UpdateSection
from duralab.data import Channel, Rig, Signals
from duralab.errors import InputError
from duralab_proto.arrays import to_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2

_UPDATES = {
    Algorithm.SECANT: iterator_pb2.UPDATE_KIND_SECANT,
    Algorithm.ADAPTIVE_MODELLING: iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING,
    Algorithm.BASIC_TWR: iterator_pb2.UPDATE_KIND_BASIC_TWR,
}

GAUSSIAN_CREST = 3.0
"""Noise and random phases pass this multiple of their RMS often: a drive without room for it is refused at once."""


def check_against_rig(campaign: Campaign, rig: Rig) -> None:
    """Check everything of a campaign that depends on the rig, before anything is played.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    rig : Rig
        The rig that is to play it.

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
    name, given = excitation.levels
    levels = per_channel(given, rig.drives, key=f"excitation.{name}")
    # A peak is the drive's largest magnitude itself; a sweep and chosen phases stay near their RMS.
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
    _check_drive_spectra(excitation, rig)
    response_gains(campaign.update, rig=rig)
    response_weights(campaign.update, rig=rig)
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


def response_gains(update: UpdateSection, *, rig: Rig) -> np.ndarray:
    """Return the gain of each response, from its group where that has one; shape (responses).

    Raises
    ------
    InputError
        A channel is unknown, or a response has no gain or two.
    """
    _require_responses(
        [name for group in update.groups.values() for name in group.channels], rig=rig, key="update.groups"
    )
    gains = {name: group.gain for group in update.groups.values() if group.gain is not None for name in group.channels}
    others = tuple(channel for channel in rig.responses if channel.name not in gains)
    for channel, gain in zip(others, per_channel(update.gain, others, key="update.gain"), strict=True):
        gains[channel.name] = float(gain)
    return np.array([gains[channel.name] for channel in rig.responses])


def response_weights(update: UpdateSection, *, rig: Rig) -> np.ndarray | None:
    """Return how much each response counts, 0 where it is watched; None where all count alike; shape (responses).

    Raises
    ------
    InputError
        A channel is unknown, or fewer responses are controlled than there are drives.
    """
    _require_responses(list(update.watch), rig=rig, key="update.watch")
    _require_responses(list(update.weights), rig=rig, key="update.weights")
    given = {name: group.weight for group in update.groups.values() for name in group.channels if group.weight}
    given |= update.weights | dict.fromkeys(update.watch, 0.0)
    if not given:
        return None
    controlled = len(rig.responses) - len(update.watch)
    if controlled < len(rig.drives):
        raise InputError(
            f"update.watch leaves {controlled} of {len(rig.responses)} responses to control; rig {rig.name!r} has "
            f"{len(rig.drives)} drives and needs as many at least.",
            field="update.watch",
        )
    return np.array([float(given.get(channel.name, 1.0)) for channel in rig.responses])


def _require_responses(names: list[str], *, rig: Rig, key: str) -> None:
    known = [channel.name for channel in rig.responses]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(
            f"{key} has unknown channel {', '.join(unknown)}; the responses are {', '.join(known)}.", field=key
        )


def acceptance_message(accept: Acceptance) -> iterator_pb2.Acceptance:
    """Put what a result is judged by into the words of the contract.

    Parameters
    ----------
    accept : Acceptance
        What the user wrote.

    Returns
    -------
    Acceptance
        A limit that is not judged is left out.
    """
    return iterator_pb2.Acceptance(
        relative_rms_error=accept.relative_rms_error,
        peak_ratio=accept.peak_ratio or (),
        damage_ratio=accept.damage_ratio or (),
        damage_exponent=accept.damage_exponent or 0,
        energy_outside_band=accept.energy_outside_band,
    )


def excitation_message(excitation: ExcitationSettings, *, rig: Rig, seed: int) -> identifier_pb2.Excitation:
    """Put the excitation into the words of the contract.

    Parameters
    ----------
    excitation : ExcitationSettings
        What the user wrote.
    rig : Rig
        The rig that is identified.
    seed : int
        Of what is random in it.

    Returns
    -------
    Excitation
        The settings as the identifier takes them.

    Raises
    ------
    InputError
        A level or a spectrum is that of an unknown drive, or a level is missing.
    """
    _check_drive_spectra(excitation, rig)
    name, given = excitation.levels
    message = identifier_pb2.Excitation(
        kind=f"EXCITATION_KIND_{excitation.kind.name}",
        duration_seconds=excitation.duration,
        fade_seconds=excitation.fade,
        seed=seed,
        delay_blocks=excitation.delay_blocks,
        capture_blocks=excitation.capture_blocks,
        repeats=excitation.repeats,
        realisations=excitation.realisations or 0,
        odd_lines=excitation.odd_lines,
        detection_share=excitation.detection_share,
        minimise_crest_factor=excitation.minimise_crest_factor,
        burst_share=excitation.burst_share,
    )
    getattr(message, name).CopyFrom(to_array(per_channel(given, rig.drives, key=f"excitation.{name}")))
    common = _white_pink(excitation, excitation.corner_frequency, excitation.decibels_per_octave)
    if not excitation.drive_spectra:
        message.spectrum.CopyFrom(common)
        return message
    for channel in rig.drives:
        own, spectrum = excitation.drive_spectra.get(channel.name), message.drive_spectra.add()
        if own is None:
            spectrum.white_pink.CopyFrom(common)
        elif own.table is not None:
            points = np.array(own.table, dtype=np.float64)
            spectrum.table.frequency.CopyFrom(to_array(points[:, 0]))
            spectrum.table.density.CopyFrom(to_array(points[:, 1]))
        else:
            corner = own.corner_frequency or excitation.corner_frequency
            spectrum.white_pink.CopyFrom(_white_pink(excitation, corner, own.decibels_per_octave))
    return message


def _check_drive_spectra(excitation: ExcitationSettings, rig: Rig) -> None:
    drives = [channel.name for channel in rig.drives]
    unknown = [drive for drive in excitation.drive_spectra or {} if drive not in drives]
    if unknown:
        raise InputError(
            f"excitation.drive_spectra has unknown channel {', '.join(unknown)}; the drives are {', '.join(drives)}.",
            field="excitation.drive_spectra",
        )


def _white_pink(
    excitation: ExcitationSettings, corner_frequency: float, decibels_per_octave: float
) -> identifier_pb2.WhitePinkSpectrum:
    return identifier_pb2.WhitePinkSpectrum(
        lowest_frequency=excitation.lowest_frequency,
        highest_frequency=excitation.highest_frequency,
        corner_frequency=corner_frequency,
        decibels_per_octave=decibels_per_octave,
    )


def estimator_message(estimator: EstimatorSettings) -> identifier_pb2.Estimator:
    """Put the estimator into the words of the contract.

    Parameters
    ----------
    estimator : EstimatorSettings
        Settings of the estimator.

    Returns
    -------
    Estimator
        The settings as the identifier takes them.
    """
    return identifier_pb2.Estimator(
        kind=f"ESTIMATOR_KIND_{estimator.kind.name}",
        block_samples=estimator.block_samples,
        overlap=estimator.overlap,
        local_order=estimator.local_order or 0,
        local_half_width=estimator.local_half_width or 0,
    )


def update_message(update: UpdateSection, *, rig: Rig) -> iterator_pb2.UpdateSettings:
    """Put the update into the words of the contract.

    Parameters
    ----------
    update : UpdateSection
        Settings of the update.
    rig : Rig
        The rig, whose responses have the gains and weights.

    Returns
    -------
    UpdateSettings
        The settings as the iterator takes them.
    """
    message = iterator_pb2.UpdateSettings(
        kind=_UPDATES[update.algorithm],
        iteration_gain=to_array(response_gains(update, rig=rig)),
        accept_segments=update.accepts_segments,
        gain_schedule=update.gain_schedule,
        smallest_correction=update.smallest_correction,
        largest_correction=update.largest_correction,
        weigh_by_coherence=update.weigh_by_coherence,
        lowest_coherence=update.lowest_coherence,
        prediction=f"CORRECTION_PREDICTION_{update.prediction.name}",
        shape=f"CORRECTION_SHAPE_{update.correction.name}",
        secant=iterator_pb2.SecantSettings(
            forgetting=update.forgetting,
            prior_strength=update.prior_strength,
            caution=update.caution,
            regularisation=update.regularisation,
        ),
    )
    weights = response_weights(update, rig=rig)
    if weights is not None:
        message.response_weight.CopyFrom(to_array(weights))
    if update.gain_curve:
        shares = [per_channel(point.share, rig.responses, key="update.gain_curve") for point in update.gain_curve]
        frequencies = np.array([point.frequency for point in update.gain_curve])
        message.gain_curve_frequency.CopyFrom(to_array(frequencies))
        message.gain_curve_share.CopyFrom(to_array(np.stack(shares)))
    return message


def stop_message(stop: StopSection) -> iterator_pb2.StopCriteria:
    """Put the stop criteria into the words of the contract.

    Parameters
    ----------
    stop : StopSection
        Stop criteria of a campaign file.

    Returns
    -------
    StopCriteria
        The criteria as the iterator takes them.
    """
    return iterator_pb2.StopCriteria(
        largest_iterations=stop.iterations,
        relative_rms_error=stop.relative_rms_error,
        divergence_ratio=stop.divergence_ratio,
        smallest_damage_ratio=stop.damage_ratio[0] if stop.damage_ratio is not None else 0.0,
        largest_damage_ratio=stop.damage_ratio[1] if stop.damage_ratio is not None else 0.0,
        damage_exponent=float(stop.damage_exponent),
        damage_budget=stop.damage_budget,
        error_bound=_bound(stop.error_bound),
        peak_bound=_bound(stop.peak_bound),
        damage_bound=_bound(stop.damage_bound),
        smallest_improvement=stop.smallest_improvement,
        improvement_playbacks=stop.improvement_playbacks,
    )


def _bound(value: float | None) -> float:
    """Return a bound of the contract, which is infinite for none."""
    return np.inf if value is None else value


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

    Returns
    -------
    CampaignSpec
        The campaign as the iterator takes it.
    """
    return iterator_pb2.CampaignSpec(
        id=id,
        rig=rig.name,
        target=target.to_message(),
        target_source=source,
        excitation=excitation_message(campaign.excitation, rig=rig, seed=campaign.seed),
        estimator=estimator_message(campaign.estimator),
        update=update_message(campaign.update, rig=rig),
        stop=stop_message(campaign.stop),
        lowest_frequency=campaign.control_band.lowest_frequency,
        highest_frequency=campaign.control_band.highest_frequency,
        lower_flank=campaign.control_band.lower_flank or 0.0,
        upper_flank=campaign.control_band.upper_flank or 0.0,
        largest_overrun=campaign.largest_overrun,
        seed=campaign.seed,
        scenario=campaign.text,
        levels=campaign.levels,
        limit_policy=f"LIMIT_POLICY_{campaign.at_limits.name}",
        confirmations=campaign.confirm.playbacks,
        real_time=campaign.real_time,
        accept=acceptance_message(campaign.accept),
    )
