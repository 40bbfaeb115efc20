"""A campaign's specification, checked as a whole against its rig before anything moves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray
from pydantic import BaseModel

from duralab_bus import FaultError
from duralab_loads import channel_damage
from duralab_proto.arrays import from_record
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, query_pb2, rig_pb2
from duralab_settings import (
    Acceptance,
    AtTarget,
    EstimatorSettings,
    HoldPoint,
    HoldSettings,
    PlaybackSettings,
    ResolvedExcitation,
    ResolvedUpdate,
    SettingsError,
    StopCriteria,
    UpdateKind,
)
from duralab_settings.messages import from_message
from duralab_spectra import count_blocks, rms
from iterator.band import ControlBand, OutsideBand, control_band, energy_outside_band
from iterator.campaign.static_part import require_static_hold, static_remarks, static_response_of
from iterator.campaign.target_reach import require_reach, tiny_target_remarks
from iterator.limits import DriveLimits
from iterator.model import FEWEST_LINES, checked_response_weight
from iterator.playbacks import CampaignSettings
from iterator.updates import FEWEST_BLOCKS, UpdateSettings, plugin_update

# Rounding residue of a constant target in the control band, relative to the constant.
_ROUNDING: Final = 1e-9
# In any unit of a response far beyond any load: transforms and squares of it stay finite.
_LARGEST_TARGET: Final = 1e12
# A smaller share of the target's energy outside the control band is not reported.
_TOLD_SHARE: Final = 0.01
# Largest padding of a record that is shorter than its padding: 42 MB per channel.
_MOST_RINGING: Final = 5 * 2**20

_S = TypeVar("_S", bound=BaseModel)


@dataclass(frozen=True)
class CampaignPlan:
    """A checked campaign.

    `spec`: As it was sent. `description`: The rig it was checked against. `target_in_band`, shape (n_y, samples):
    Target that the responses are judged against. `settings`: Settings of the iteration and its end. `limits`: Drive
    limits of the rig. `experiment`: Experiment of the identification, as the identifier answered. `response_weight`,
    shape (n_y,): The specification's weight over the target's RMS, so that responses of any unit count equally; 0 for a
    monitored response. `target_energy_outside_band`, shape (n_y,): Share of the energy of each target's dynamic part
    outside the control band, 0 to 1. `target_damage`, shape (n_y, exponents): Pseudo-damage of one pass of the target
    as measured; 0 for a silent one. `hold`: Hold points before playbacks. `judged_target`: Number of changes of the
    control band. `remarks`: Notes for a person before the start, one sentence each.
    """

    spec: iterator_pb2.CampaignSpec
    description: rig_pb2.RigDescription
    target_in_band: NDArray[np.float64]
    settings: CampaignSettings
    limits: DriveLimits
    experiment: identifier_pb2.ExperimentPlan
    response_weight: NDArray[np.float64]
    target_energy_outside_band: NDArray[np.float64]
    target_damage: NDArray[np.float64]
    hold: HoldSettings
    judged_target: int = 0
    remarks: tuple[str, ...] = ()

    @property
    def identified_band(self) -> tuple[float, float]:
        """Lowest and highest frequency at which the model will be valid, Hz."""
        return self.experiment.lowest_frequency, self.experiment.highest_frequency

    @property
    def controlled_names(self) -> list[str]:
        """Names of the controlled responses, in the rig's order."""
        names = (channel.name for channel in self.description.responses)
        return [name for name, weight in zip(names, self.response_weight, strict=True) if weight > 0.0]

    @property
    def share_at_target(self) -> float:
        """Share of the identification's duration that is its experiment at the target, by their settings."""
        first, second = self.spec.excitation.duration, self.spec.at_target.duration
        return second / (first + second) if self.spec.HasField("at_target") else 0.0

    @property
    def map_weight(self) -> NDArray[np.float64] | None:
        """Weight of each response in learning a drive map; None if no map is learned."""
        return self.response_weight if self.settings.update.drive_map.learn else None


def plan_campaign(
    spec: iterator_pb2.CampaignSpec,
    description: rig_pb2.RigDescription,
    experiment: identifier_pb2.ExperimentPlan,
) -> CampaignPlan:
    """Check a specification against its rig.

    `spec`: As received, untrusted. Its id and rig are names that the contract allows. `description`: Description of
    that rig. `experiment`: Experiment of the identification: the identifier has checked excitation and estimator.
    Returns: A plan that can be run.
    Raises `FaultError`: INVALID_ARGUMENT with the field, or FAILED_PRECONDITION if the rig does not allow the
    method. `ArrayError`: An array or record of the specification is damaged; the bus makes it INVALID_ARGUMENT.
    """
    if len(description.responses) < len(description.drives):
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"The rig {spec.rig!r} has {len(description.drives)} drives and {len(description.responses)} responses; "
            "Time Waveform Replication needs at least as many responses as drives.",
            field="rig",
        )
    for channel in description.drives:
        if not 0.0 <= channel.actuator_speed < np.inf:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"The rig {spec.rig!r} states an actuator_speed of {channel.actuator_speed:g} {channel.unit}/s for "
                f"{channel.name}; it must be finite, and 0 where it is not known: correct the rig's description.",
                field="rig",
            )
    target = _checked_target(spec, description)
    _check_experiment(spec, experiment)
    band = _checked_band(spec, description, experiment, samples=target.shape[1])
    resolved = _settings(spec.update, ResolvedUpdate, field="update")
    plugin_remarks = checked_plugin(resolved)
    weight = _checked_weight(resolved, description)
    _check_at_target(spec, description, experiment, controlled=weight > 0.0)
    if band.lowest == 0.0:
        require_static_hold(spec, description=description, controlled=weight > 0.0)
    update = UpdateSettings.model_construct(band=band, **dict(resolved))
    settings = CampaignSettings.model_construct(update=update, **_checked_playbacks(spec))
    if spec.HasField("accept"):
        _settings(spec.accept, Acceptance, field="accept")
    _check_target_length(spec, update, samples=target.shape[1])
    target_in_band = band.limit_target(target)
    silent = rms(target_in_band) <= _ROUNDING * np.max(np.abs(target), axis=1)
    # The rounding residue of a silent target is set to 0; only a monitored response may have one.
    target_in_band[silent] = 0.0
    if np.any(silent & (weight > 0.0)):
        names = ", ".join(description.responses[i].name for i in np.flatnonzero(silent & (weight > 0.0)))
        raise invalid(
            f"The target of {names} does not move between {spec.lowest_frequency:g} and {spec.highest_frequency:g} Hz; "
            "every response that is controlled needs a target in the control band: give it one, or the weight 0 to "
            "watch it only.",
            field="target.samples",
        )
    require_reach(target_in_band, spec.target_steps, description=description, controlled=weight > 0.0)
    outside = energy_outside_band(target, band)
    return CampaignPlan(
        spec=spec,
        description=description,
        target_in_band=target_in_band,
        settings=settings,
        limits=drive_limits(description),
        experiment=experiment,
        response_weight=np.divide(weight, rms(target_in_band), out=np.zeros_like(weight), where=weight > 0.0),
        target_energy_outside_band=outside.below + outside.above,
        target_damage=np.where(silent[:, None], 0.0, channel_damage(target)),
        hold=_hold(spec, description),
        remarks=(
            *plugin_remarks,
            *_outside_the_band(outside, band, description),
            *static_remarks(target, target_in_band, band=band, description=description),
            *tiny_target_remarks(target_in_band, description=description, controlled=weight > 0.0),
        ),
    )


def _hold(spec: iterator_pb2.CampaignSpec, description: rig_pb2.RigDescription) -> HoldSettings:
    """Return the hold points: on a real rig a person sees the first drive, unless the campaign states otherwise."""
    if spec.HasField("hold"):
        return _settings(spec.hold, HoldSettings, field="hold")
    return HoldSettings(when=HoldPoint.NEVER if description.simulated else HoldPoint.FIRST)


def invalid(message: str, *, field: str) -> FaultError:
    """Return the fault for a value of a specification that is not allowed."""
    return FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, message, field=field)


def _settings(message: Message, model: type[_S], *, field: str = "") -> _S:
    try:
        return from_message(message, model, field=field)
    except SettingsError as error:
        raise invalid(str(error), field=error.field) from error


def checked_plugin(update: ResolvedUpdate) -> tuple[str, ...]:
    """Load the plug-in of an update; return a remark that names it, nothing if there is none."""
    if update.plugin is None:
        return ()
    try:
        return (plugin_update(update.plugin)[1],)
    except SettingsError as error:
        raise invalid(str(error), field=error.field) from error


def _checked_playbacks(spec: iterator_pb2.CampaignSpec) -> dict[str, Any]:
    """Return the playback settings and the stop criteria."""
    playbacks, stop = _settings(spec, PlaybackSettings), _settings(spec.stop, StopCriteria, field="stop")
    try:
        playbacks.require_whole_playback(stop)
    except ValueError as error:
        raise invalid(f"{error}.", field="levels") from error
    return {**dict(playbacks), "stop": stop}


def _checked_weight(update: ResolvedUpdate, description: rig_pb2.RigDescription) -> NDArray[np.float64]:
    """Return the weight of each response; 0 for a monitored response."""
    responses, drives = len(description.responses), len(description.drives)
    if len(update.iteration_gain) != responses:
        raise invalid(
            f"The update has {len(update.iteration_gain)} iteration gains; each of the {responses} responses needs "
            "one.",
            field="update.iteration_gain",
        )
    if update.weights is None:
        return np.ones(responses)
    try:
        return checked_response_weight(np.array(update.weights), responses=responses, drives=drives)
    except ValueError as error:
        raise invalid(str(error), field="update.weights") from error


def _outside_the_band(outside: OutsideBand, band: ControlBand, description: rig_pb2.RigDescription) -> tuple[str, ...]:
    """Return the remark on the part of the target outside the control band."""
    parts = [
        f"{channel.name} {100 * below:.1f} % below and {100 * above:.1f} % above"
        for channel, below, above in zip(description.responses, outside.below, outside.above, strict=True)
        if below + above >= _TOLD_SHARE
    ]
    if not parts:
        return ()
    return (
        f"Part of the target's energy lies outside the control band of {band.lowest:g} to {band.highest:g} Hz and is "
        f"not reproduced: {'; '.join(parts)}.",
    )


def _check_experiment(spec: iterator_pb2.CampaignSpec, experiment: identifier_pb2.ExperimentPlan) -> None:
    """Check the campaign's requirements for its identification beyond those of the identifier."""
    if spec.excitation.seed not in (0, spec.seed):
        raise invalid(
            f"The excitation's seed is {spec.excitation.seed}; leave it 0, every seed comes from the campaign's own.",
            field="excitation.seed",
        )
    width = experiment.highest_frequency - experiment.lowest_frequency
    if not width >= FEWEST_LINES * experiment.frequency_resolution > 0.0:
        raise invalid(
            f"Blocks of {spec.estimator.block_samples} samples have lines {experiment.frequency_resolution:g} Hz "
            f"apart, too far for the excitation's band of {width:g} Hz; at least {FEWEST_LINES} must fit: take "
            "longer blocks.",
            field="estimator.block_samples",
        )


def _check_at_target(
    spec: iterator_pb2.CampaignSpec,
    description: rig_pb2.RigDescription,
    experiment: identifier_pb2.ExperimentPlan,
    *,
    controlled: NDArray[np.bool_],
) -> None:
    """Check the settings of the experiment at the target; the identifier has checked its length."""
    if not spec.HasField("at_target"):
        return
    _settings(spec.at_target, AtTarget, field="at_target")
    kind = _settings(spec.excitation, ResolvedExcitation, field="excitation").kind
    if not kind.is_multisine:
        raise invalid(
            f"The excitation is {kind.value}, and only a multisine can have the spectra of a target; take "
            "random_orthogonal, or leave excitation.at_target out.",
            field="at_target",
        )
    if np.count_nonzero(controlled) != len(description.drives):
        raise invalid(
            f"The campaign controls {np.count_nonzero(controlled)} responses with {len(description.drives)} drives; an "
            "experiment at the target needs as many of both, so leave excitation.at_target out.",
            field="at_target",
        )
    estimator = _settings(spec.estimator, EstimatorSettings, field="estimator").kind
    drives, experiments = len(description.drives), experiment.realisations * experiment.experiments_per_realisation
    if not (spec.known.HasField("model") or estimator.is_local or experiments > drives):
        raise invalid(
            f"The identification has {experiments} experiments for {drives} drives, from which {estimator.value} "
            "cannot say how uncertain its model is, and the experiment at the target needs that; make "
            "excitation.duration twice as long, or take local_polynomial.",
            field="at_target",
        )


def _checked_target(spec: iterator_pb2.CampaignSpec, description: rig_pb2.RigDescription) -> NDArray[np.float64]:
    if not spec.HasField("target"):
        raise invalid("The campaign has no target; give the record to reproduce.", field="target")
    channels, sample_rate, samples = from_record(spec.target, field="target")
    wanted = [(channel.name, channel.unit) for channel in description.responses]
    given = [(channel.name, channel.unit) for channel in channels]
    if [name for name, _ in given] != [name for name, _ in wanted]:
        raise invalid(
            f"The target's {len(given)} channels are {_names(channels)}; rig {spec.rig!r} needs its {len(wanted)} "
            f"responses in this order: {_names(description.responses)}.",
            field="target.channels",
        )
    for (name, given_unit), (_, unit) in zip(given, wanted, strict=True):
        if given_unit != unit:
            raise invalid(
                f"The target of {name} is in {given_unit!r}; the rig measures it in {unit!r}: convert it.",
                field="target.channels",
            )
    if sample_rate != description.sample_rate:
        raise invalid(
            f"The target is sampled at {sample_rate:g} Hz; rig {spec.rig!r} plays {description.sample_rate:g} Hz only: "
            "resample it.",
            field="target.sample_rate",
        )
    if samples.shape[1] == 0:
        raise invalid("The target is empty; it needs samples.", field="target.samples")
    seconds = samples.shape[1] / sample_rate
    if seconds > description.longest_drive_seconds:
        raise invalid(
            f"The target lasts {seconds:g} s; rig {spec.rig!r} plays at most {description.longest_drive_seconds:g} s: "
            "cut it into parts.",
            field="target.samples",
        )
    channel, sample = np.unravel_index(np.argmax(np.abs(samples)), samples.shape)
    if not abs(samples[channel, sample]) <= _LARGEST_TARGET:
        raise invalid(
            f"The target of {wanted[channel][0]} is {samples[channel, sample]:g} at sample {sample}; at most "
            f"{_LARGEST_TARGET:g} is allowed, which no load comes near: see what wrote it.",
            field="target.samples",
        )
    return samples


def _names(channels: Iterable[array_pb2.Channel]) -> str:
    return ", ".join(channel.name for channel in channels)


def _checked_band(
    spec: iterator_pb2.CampaignSpec,
    description: rig_pb2.RigDescription,
    experiment: identifier_pb2.ExperimentPlan,
    *,
    samples: int,
) -> ControlBand:
    # A band from 0 Hz needs the measured static gain: see `require_static_hold`.
    static = spec.lowest_frequency == 0.0
    try:
        band = control_band(
            spec.lowest_frequency,
            spec.highest_frequency,
            sample_rate=description.sample_rate,
            excited=(0.0 if static else experiment.lowest_frequency, experiment.highest_frequency),
            lower_flank=spec.lower_flank or None,
            upper_flank=spec.upper_flank or None,
            static_response=static_response_of(description) if static else None,
        )
    except ValueError as error:
        raise invalid(str(error), field=_band_field(spec, description, experiment)) from error
    _check_lower_edge(band, samples=samples)
    return band


def _band_field(
    spec: iterator_pb2.CampaignSpec, description: rig_pb2.RigDescription, experiment: identifier_pb2.ExperimentPlan
) -> str:
    """Return the field of a refused control band that has to change."""
    if spec.lower_flank < 0.0 or spec.upper_flank < 0.0:
        return "lower_flank" if spec.lower_flank < 0.0 else "upper_flank"
    ends = min(description.sample_rate / 2.0, experiment.highest_frequency)
    return "highest_frequency" if spec.highest_frequency + spec.upper_flank >= ends else "lowest_frequency"


def _check_lower_edge(band: ControlBand, *, samples: int) -> None:
    """Bound the zeros that a low edge needs: a tiny edge would need more memory than exists."""
    seconds = samples / band.sample_rate
    if 0.0 < band.lowest * seconds < 1.0:
        raise invalid(
            f"The control band begins at {band.lowest:g} Hz, of which a period lasts {1.0 / band.lowest:g} s; the "
            f"target lasts {seconds:g} s and must hold one: take a higher edge or a longer target.",
            field="lowest_frequency",
        )
    if band.ringing_samples > max(samples, _MOST_RINGING):
        raise invalid(
            f"The control band of {band.lowest:g} to {band.highest:g} Hz rings for {band.ringing_samples:g} samples; "
            f"{_MOST_RINGING} are the most for a target of {samples}: take a higher lower edge.",
            field="lowest_frequency",
        )


def _check_target_length(spec: iterator_pb2.CampaignSpec, update: UpdateSettings, *, samples: int) -> None:
    block = spec.estimator.block_samples
    if update.kind is UpdateKind.ADAPTIVE_MODELLING and update.plugin is None:
        blocks = count_blocks(samples, block, update.correction_overlap)
        if blocks < FEWEST_BLOCKS:
            raise invalid(
                f"The target has {samples} samples; Adaptive Modelling averages over blocks of {block} and needs at "
                f"least {FEWEST_BLOCKS} with {100 * update.correction_overlap:.0f} % overlap: take a longer target, "
                "shorter blocks or basic TWR.",
                field="target.samples",
            )


def drive_limits(description: rig_pb2.RigDescription) -> DriveLimits:
    """Return the limits of each drive of a rig.

    `description`: Description of the rig.
    Returns: Limits in the order of its drives.
    """
    drives = description.drives
    return DriveLimits(
        names=tuple(channel.name for channel in drives),
        units=tuple(channel.unit for channel in drives),
        minimum=np.array([channel.minimum for channel in drives]),
        maximum=np.array([channel.maximum for channel in drives]),
        slew_limit=np.array([channel.slew_limit for channel in drives]),
        sample_rate=description.sample_rate,
        actuator_speed=np.array([channel.actuator_speed for channel in drives]),
    )
