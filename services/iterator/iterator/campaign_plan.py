"""A campaign's specification, checked as a whole against its rig before anything moves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_proto.arrays import from_array, from_record
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, query_pb2, rig_pb2
from iterator.adaptive_modelling import FEWEST_BLOCKS
from iterator.control_band import ControlBand, control_band
from iterator.drive_limits import DriveLimits
from iterator.drive_update import CorrectionSettings, UpdateKind, UpdateSettings
from iterator.iteration_loop import CampaignSettings
from iterator.rig_model import FEWEST_LINES
from iterator.stop_criteria import StopCriteria
from labbus import FaultError
from spectra import count_blocks, rms

_UPDATE_KINDS: Final = {
    iterator_pb2.UPDATE_KIND_BASIC_TWR: UpdateKind.BASIC_TWR,
    iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING: UpdateKind.ADAPTIVE_MODELLING,
}
# What rounding leaves of a constant target in the control band, relative to the constant.
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class CampaignPlan:
    """A checked campaign.

    Parameters
    ----------
    spec : CampaignSpec
        As it was sent.
    description : RigDescription
        The rig it was checked against.
    target_in_band : ndarray, shape (n_y, samples)
        What the responses are judged against.
    settings : CampaignSettings
        How to iterate and when to end.
    limits : DriveLimits
        Of the rig.
    experiment : ExperimentPlan
        Of the identification, as the identifier told it.
    """

    spec: iterator_pb2.CampaignSpec
    description: rig_pb2.RigDescription
    target_in_band: NDArray[np.float64]
    settings: CampaignSettings
    limits: DriveLimits
    experiment: identifier_pb2.ExperimentPlan

    @property
    def identified_band(self) -> tuple[float, float]:
        """Lowest and highest frequency at which the model will be valid, Hz."""
        return self.experiment.lowest_frequency, self.experiment.highest_frequency


def invalid(message: str, *, field: str) -> FaultError:
    """Return the fault for a value of a specification that is not allowed."""
    return FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, message, field=field)


def plan_campaign(
    spec: iterator_pb2.CampaignSpec,
    description: rig_pb2.RigDescription,
    experiment: identifier_pb2.ExperimentPlan,
) -> CampaignPlan:
    """Check a specification against the rig it is for.

    Parameters
    ----------
    spec : CampaignSpec
        As received; nothing in it is trusted. Its id and rig are names that the contract allows.
    description : RigDescription
        Of that rig.
    experiment : ExperimentPlan
        Of the identification: the identifier has checked the excitation and the estimator.

    Returns
    -------
    CampaignPlan
        Ready to run.

    Raises
    ------
    FaultError
        INVALID_ARGUMENT with the field, or FAILED_PRECONDITION where the rig does not allow the method.
    ArrayError
        An array or record of the specification is damaged; the bus makes it INVALID_ARGUMENT.
    """
    if len(description.responses) < len(description.drives):
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"The rig {spec.rig!r} has {len(description.drives)} drives and {len(description.responses)} responses; "
            "Time Waveform Replication needs at least as many responses as drives.",
            field="rig",
        )
    target = _checked_target(spec, description)
    _check_experiment(spec, experiment)
    band = _checked_band(spec, description, experiment)
    update = _checked_update(spec, band, responses=len(description.responses))
    stop = _checked_stop(spec.stop)
    _check_target_length(spec, update, samples=target.shape[1])
    target_in_band = band.limit_target(target)
    silent = np.flatnonzero(rms(target_in_band) <= _ROUNDING * np.max(np.abs(target), axis=1))
    if silent.size:
        names = ", ".join(description.responses[i].name for i in silent)
        raise invalid(
            f"The target of {names} does not move between {spec.lowest_frequency:g} and {spec.highest_frequency:g} Hz; "
            "every response needs a target in the control band.",
            field="target.samples",
        )
    return CampaignPlan(
        spec=spec,
        description=description,
        target_in_band=target_in_band,
        settings=CampaignSettings(update=update, stop=stop),
        limits=_limits(description),
        experiment=experiment,
    )


def _check_experiment(spec: iterator_pb2.CampaignSpec, experiment: identifier_pb2.ExperimentPlan) -> None:
    """Check what the campaign asks of its identification beyond what the identifier does."""
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
    return samples


def _names(channels: Iterable[array_pb2.Channel]) -> str:
    return ", ".join(channel.name for channel in channels)


def _checked_band(
    spec: iterator_pb2.CampaignSpec,
    description: rig_pb2.RigDescription,
    experiment: identifier_pb2.ExperimentPlan,
) -> ControlBand:
    try:
        band = control_band(spec.lowest_frequency, spec.highest_frequency, sample_rate=description.sample_rate)
    except ValueError as error:
        above = spec.highest_frequency > description.sample_rate / 2.0
        raise invalid(str(error), field="highest_frequency" if above else "lowest_frequency") from error
    for field, inside in (
        ("lowest_frequency", band.lowest >= experiment.lowest_frequency),
        ("highest_frequency", band.highest <= experiment.highest_frequency),
    ):
        if not inside:
            raise invalid(
                f"The control band is {band.lowest:g} to {band.highest:g} Hz; it must lie within the excitation's, "
                f"{experiment.lowest_frequency:g} to {experiment.highest_frequency:g} Hz, where the model is known.",
                field=field,
            )
    return band


def _checked_update(spec: iterator_pb2.CampaignSpec, band: ControlBand, *, responses: int) -> UpdateSettings:
    update = spec.update
    kind = _UPDATE_KINDS.get(update.kind)
    if kind is None:
        offered = ", ".join(f"{known.name} ({number})" for number, known in _UPDATE_KINDS.items())
        raise invalid(f"The kind of update is {update.kind}; offered are {offered}.", field="update.kind")
    gain = from_array(update.iteration_gain, field="update.iteration_gain", shape=(None,), dtype=np.float64)
    if gain.size != responses:
        raise invalid(
            f"The update has {gain.size} iteration gains; each of the {responses} responses needs one.",
            field="update.iteration_gain",
        )
    try:
        correction = CorrectionSettings()
        if kind is UpdateKind.ADAPTIVE_MODELLING:
            correction = CorrectionSettings(
                smallest=update.smallest_correction,
                largest=update.largest_correction,
                weigh_by_coherence=update.weigh_by_coherence,
                lowest_coherence=update.lowest_coherence,
            )
    except ValueError as error:
        raise invalid(str(error), field="update.smallest_correction") from error
    try:
        return UpdateSettings(band=band, iteration_gain=gain, kind=kind, correction=correction)
    except ValueError as error:
        raise invalid(str(error), field="update.iteration_gain") from error


def _checked_stop(stop: iterator_pb2.StopCriteria) -> StopCriteria:
    try:
        return StopCriteria(
            largest_iterations=stop.largest_iterations,
            relative_rms_error=stop.relative_rms_error,
            divergence_ratio=stop.divergence_ratio,
        )
    except ValueError as error:
        raise invalid(str(error), field="stop") from error


def _check_target_length(spec: iterator_pb2.CampaignSpec, update: UpdateSettings, *, samples: int) -> None:
    block = spec.estimator.block_samples
    if update.kind is UpdateKind.ADAPTIVE_MODELLING:
        blocks = count_blocks(samples, block, update.correction.overlap)
        if blocks < FEWEST_BLOCKS:
            raise invalid(
                f"The target has {samples} samples; Adaptive Modelling averages over blocks of {block} and needs at "
                f"least {FEWEST_BLOCKS} with {update.correction.overlap:.0%} overlap: take a longer target, "
                "shorter blocks or basic TWR.",
                field="target.samples",
            )


def _limits(description: rig_pb2.RigDescription) -> DriveLimits:
    drives = description.drives
    return DriveLimits(
        names=tuple(channel.name for channel in drives),
        units=tuple(channel.unit for channel in drives),
        minimum=np.array([channel.minimum for channel in drives]),
        maximum=np.array([channel.maximum for channel in drives]),
        slew_limit=np.array([channel.slew_limit for channel in drives]),
        sample_rate=description.sample_rate,
    )
