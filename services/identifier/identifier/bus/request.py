"""Conversion of an IdentifyRequest to settings."""

import numpy as np

from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.keys import check_rig, check_run
from duralab_proto.v1 import identifier_pb2
from duralab_settings import EstimatorSettings, ExcitationKind, ResolvedExcitation, SettingsError
from duralab_settings.messages import from_message
from duralab_spectra import hop_samples
from identifier.excitation import ExperimentSettings
from identifier.experiment import IdentificationSettings


def settings_of(request: identifier_pb2.IdentifyRequest) -> IdentificationSettings:
    """Read and check a request.

    `request`: As received, untrusted.
    Returns: Settings that are valid alone, not yet checked against the rig.
    Raises `SettingsError`: A name or value is not allowed.
    """
    for field, check, name in (("rig", check_rig, request.rig), ("run", check_run, request.run)):
        try:
            check(name)
        except ValueError as error:
            raise SettingsError(str(error), field=field) from error
    excitation = from_message(request.excitation, ResolvedExcitation, field="excitation")
    estimator = from_message(request.estimator, EstimatorSettings, field="estimator")
    if excitation.kind is ExcitationKind.PURE_RANDOM:
        try:
            hop_samples(estimator.block_samples, estimator.overlap)
        except ValueError as error:
            raise SettingsError(str(error), field="estimator.overlap") from error
    blocks = {"block_samples": estimator.block_samples, "overlap": estimator.overlap}
    return IdentificationSettings(
        ExperimentSettings.model_construct(**dict(excitation), **blocks),
        estimator,
        learn_drive_map=request.HasField("drive_map"),
        response_weight=_response_weight(request.drive_map),
    )


def _response_weight(request: identifier_pb2.DriveMapRequest) -> tuple[float, ...] | None:
    if not request.HasField("response_weight"):
        return None
    field = "drive_map.response_weight"
    try:
        weight = from_array(request.response_weight, field=field, shape=(None,), dtype=np.float64)
    except ArrayError as error:
        raise SettingsError(str(error), field=error.field) from error
    if np.any(weight < 0.0):
        raise SettingsError(f"The weights of the responses are {weight.tolist()}; each must be 0 or more.", field=field)
    return tuple(weight.tolist())
