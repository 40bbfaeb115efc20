"""From an IdentifyRequest to settings, and from settings and estimate to a model."""

import numpy as np

from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.keys import check_rig, check_run
from duralab_proto.v1 import identifier_pb2, rig_pb2
from identifier.h1 import FrfEstimate
from identifier.model import IdentifiedModel, with_id
from identifier.rig_under_test import RigUnderTest
from identifier.settings import ExperimentSettings, SettingError, WhitePink
from identifier.uncertainty import frf_variance


def settings_of(request: identifier_pb2.IdentifyRequest) -> ExperimentSettings:
    """Read and check a request.

    Parameters
    ----------
    request
        As received; nothing in it is trusted.

    Returns
    -------
    ExperimentSettings
        Sound by themselves, not yet checked against the rig.

    Raises
    ------
    SettingError
        Where a name or value is not allowed.
    """
    _check_names(request)
    excitation, estimator = request.excitation, request.estimator
    if excitation.kind != identifier_pb2.EXCITATION_KIND_PURE_RANDOM:
        raise SettingError(
            f"The excitation is of kind {excitation.kind}; this identifier plays EXCITATION_KIND_PURE_RANDOM "
            f"({identifier_pb2.EXCITATION_KIND_PURE_RANDOM}).",
            field="excitation.kind",
        )
    if estimator.kind != identifier_pb2.ESTIMATOR_KIND_H1:
        raise SettingError(
            f"The estimator is of kind {estimator.kind}; this identifier estimates by ESTIMATOR_KIND_H1 "
            f"({identifier_pb2.ESTIMATOR_KIND_H1}).",
            field="estimator.kind",
        )
    try:
        rms = from_array(excitation.rms, field="excitation.rms", shape=(None,), dtype=np.float64)
    except ArrayError as error:
        raise SettingError(str(error), field=error.field) from error
    spectrum = excitation.spectrum
    return ExperimentSettings(
        spectrum=WhitePink(
            lowest_frequency=spectrum.lowest_frequency,
            highest_frequency=spectrum.highest_frequency,
            corner_frequency=spectrum.corner_frequency,
            decibels_per_octave=spectrum.decibels_per_octave,
        ),
        rms=tuple(rms.tolist()),
        duration_seconds=excitation.duration_seconds,
        fade_seconds=excitation.fade_seconds,
        seed=excitation.seed,
        block_samples=estimator.block_samples,
        overlap=estimator.overlap,
    )


def model_of(
    request: identifier_pb2.IdentifyRequest, *, rig: RigUnderTest, estimate: FrfEstimate, played: rig_pb2.PlayResult
) -> IdentifiedModel:
    """Put together what was asked, played and estimated.

    Parameters
    ----------
    request
        What was asked for.
    rig
        What it was played on.
    estimate
        From that playback.
    played
        The playback's result, for its epoch and number of signal blocks.

    Returns
    -------
    IdentifiedModel
        With its id.
    """
    return with_id(
        IdentifiedModel(
            rig=rig.name,
            drives=rig.drives,
            responses=rig.responses,
            sample_rate=rig.sample_rate,
            frequency=estimate.frequency,
            frf=estimate.frf,
            coherence=estimate.coherence,
            condition_number=estimate.condition_number,
            frf_variance=frf_variance(estimate),
            drive_psd=estimate.drive_psd,
            response_psd=estimate.response_psd,
            excitation=request.excitation,
            estimator=request.estimator,
            blocks=estimate.blocks,
            independent_averages=estimate.independent_averages,
            rig_content_hash=rig.content_hash,
            run=request.run,
            signal_epoch=played.epoch,
            signal_blocks=played.blocks,
        )
    )


def _check_names(request: identifier_pb2.IdentifyRequest) -> None:
    for field, check, name in (("rig", check_rig, request.rig), ("run", check_run, request.run)):
        try:
            check(name)
        except ValueError as error:
            raise SettingError(str(error), field=field) from error
