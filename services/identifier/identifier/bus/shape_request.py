"""Conversion of a TargetShape message to the shape of an experiment."""

from duralab_drive_map import DriveMap
from duralab_drive_map.messages import from_message as drive_map_from_message
from duralab_proto.arrays import ArrayError, from_record
from duralab_proto.v1 import identifier_pb2
from duralab_settings import SettingsError
from identifier.experiment import RigUnderTest, TargetShape, shape_of
from identifier.modelling import IdentifiedModel, from_message

_MODEL = "shape.model"


def shape_from(message: identifier_pb2.TargetShape, *, rig: RigUnderTest) -> tuple[TargetShape, IdentifiedModel]:
    """Read and check the shape of an experiment.

    `message`: As received, untrusted. `rig`: Rig of the experiment.
    Returns: The shape, and the model in it.
    Raises `SettingsError`: The model is damaged or that of another rig, or the target does not fit it.
    """
    try:
        channels, sample_rate, target = from_record(message.target, field="shape.target")
    except ArrayError as error:
        raise SettingsError(str(error), field=error.field) from error
    try:
        model = from_message(message.model)
        drive_map = _drive_map(model)
    except ValueError as error:
        raise SettingsError(f"The model of the shape is damaged: {error}", field=_MODEL) from error
    _require_of_rig(model, rig)
    names = [channel.name for channel in rig.responses]
    unknown = [channel.name for channel in channels if channel.name not in names]
    if unknown:
        raise SettingsError(
            f"The target of the shape has {', '.join(unknown)}; the responses of rig {rig.name!r} are "
            f"{', '.join(names)}.",
            field="shape.target.channels",
        )
    if sample_rate != rig.sample_rate:
        raise SettingsError(
            f"The target of the shape is sampled at {sample_rate:g} Hz and rig {rig.name!r} plays "
            f"{rig.sample_rate:g} Hz; resample it.",
            field="shape.target.sample_rate",
        )
    if not 0.0 < message.level <= 1.0:
        raise SettingsError(
            f"The level of the shape is {message.level:g}; it must be above 0, and 1 at most.", field="shape.level"
        )
    rows = [names.index(channel.name) for channel in channels]
    shape = shape_of(
        target,
        names=tuple(channel.name for channel in channels),
        frf=model.frf[:, rows, :],
        residual_psd=model.residual_psd[:, rows],
        row_covariance=model.row_covariance,
        band=model.band,
        drive_map=drive_map,
        target_band=(message.lowest_frequency, message.highest_frequency),
        level=message.level,
    )
    return shape, model


def _drive_map(model: IdentifiedModel) -> DriveMap | None:
    if model.drive_map is None:
        return None
    return drive_map_from_message(model.drive_map, drives=model.drives, sample_rate=model.sample_rate)


def _require_of_rig(model: IdentifiedModel, rig: RigUnderTest) -> None:
    for kind, held, wanted in (
        ("drives", model.drives, rig.drives),
        ("responses", model.responses, rig.responses),
    ):
        if [channel.name for channel in held] != [channel.name for channel in wanted]:
            raise SettingsError(
                f"The {kind} of the shape's model are not those of rig {rig.name!r}; give a model of this rig.",
                field=_MODEL,
            )
    if model.rig_content_hash != rig.content_hash:
        raise SettingsError(
            f"Rig {rig.name!r} was changed after the model of the shape was made; identify it again.", field=_MODEL
        )
