"""From an IdentifyRequest to settings."""

from duralab_proto.keys import check_rig, check_run
from duralab_proto.v1 import identifier_pb2
from duralab_settings import EstimatorSettings, ExcitationKind, ResolvedExcitation, SettingsError
from duralab_settings.messages import from_message
from duralab_spectra import hop_samples
from identifier.excitation import ExperimentSettings
from identifier.experiment import IdentificationSettings


def settings_of(request: identifier_pb2.IdentifyRequest) -> IdentificationSettings:
    """Read and check a request.

    `request`: As received; nothing in it is trusted.
    Returns: Sound by themselves, not yet checked against the rig.
    Raises `SettingsError`: Where a name or value is not allowed.
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
    return IdentificationSettings(ExperimentSettings.model_construct(**dict(excitation), **blocks), estimator)
