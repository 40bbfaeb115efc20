"""From an IdentifyRequest to settings."""

from typing import Final

import numpy as np

from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.keys import check_rig, check_run
from duralab_proto.v1 import array_pb2, identifier_pb2
from identifier.estimators import EstimatorKind
from identifier.excitation import (
    ExcitationKind,
    ExcitationSettings,
    LevelKind,
    PowerSpectrum,
    TabulatedSpectrum,
    WhitePink,
)
from identifier.experiment import EstimatorSettings, IdentificationSettings
from identifier.setting_error import SettingError

# The names of the contract are those of the enums with a prefix, so that neither can grow without the other being seen.
_EXCITATIONS: Final = {
    identifier_pb2.ExcitationKind.Value(f"EXCITATION_KIND_{kind.name}"): kind for kind in ExcitationKind
}
_ESTIMATORS: Final = {identifier_pb2.EstimatorKind.Value(f"ESTIMATOR_KIND_{kind.name}"): kind for kind in EstimatorKind}

_DEFAULT_BURST_SHARE: Final = 0.5


def settings_of(request: identifier_pb2.IdentifyRequest) -> IdentificationSettings:
    """Read and check a request.

    Parameters
    ----------
    request
        As received; nothing in it is trusted.

    Returns
    -------
    IdentificationSettings
        Sound by themselves, not yet checked against the rig.

    Raises
    ------
    SettingError
        Where a name or value is not allowed.
    """
    _check_names(request)
    excitation, estimator = request.excitation, request.estimator
    kind = _EXCITATIONS.get(excitation.kind)
    if kind is None:
        raise SettingError(
            f"The excitation is of kind {excitation.kind}; offered are "
            f"{', '.join(f'{known.name} ({number})' for number, known in _EXCITATIONS.items())}.",
            field="excitation.kind",
        )
    estimator_kind = _ESTIMATORS.get(estimator.kind)
    if estimator_kind is None:
        raise SettingError(
            f"The estimator is of kind {estimator.kind}; offered are "
            f"{', '.join(f'{known.name} ({number})' for number, known in _ESTIMATORS.items())}.",
            field="estimator.kind",
        )
    level_kind, levels = _levels(excitation)
    return IdentificationSettings(
        excitation=ExcitationSettings(
            kind=kind,
            spectra=_spectra(excitation, drives=len(levels)),
            levels=levels,
            level_kind=level_kind,
            duration_seconds=excitation.duration_seconds,
            block_samples=estimator.block_samples,
            fade_seconds=excitation.fade_seconds,
            seed=excitation.seed,
            # Other kinds have no use for it; whatever stands there must not be refused.
            overlap=estimator.overlap if kind is ExcitationKind.PURE_RANDOM else 0.0,
            delay_blocks=excitation.delay_blocks or 1,
            capture_blocks=excitation.capture_blocks or 1,
            repeats=excitation.repeats or 1,
            realisations=excitation.realisations or None,
            burst_share=excitation.burst_share or _DEFAULT_BURST_SHARE,
            odd_lines=excitation.odd_lines,
            detection_share=excitation.detection_share,
            minimise_crest_factor=excitation.minimise_crest_factor,
        ),
        estimator=EstimatorSettings(
            kind=estimator_kind,
            local_order=estimator.local_order or None,
            local_half_width=estimator.local_half_width or None,
        ),
    )


def _levels(excitation: identifier_pb2.Excitation) -> tuple[LevelKind, tuple[float, ...]]:
    if excitation.HasField("peak") and excitation.HasField("rms"):
        raise SettingError(
            "The excitation has an RMS and a peak for its drives; give one of the two.", field="excitation.peak"
        )
    if excitation.HasField("peak"):
        return LevelKind.PEAK, _values(excitation.peak, field="excitation.peak")
    return LevelKind.RMS, _values(excitation.rms, field="excitation.rms")


def _spectra(excitation: identifier_pb2.Excitation, *, drives: int) -> tuple[PowerSpectrum, ...]:
    if not excitation.drive_spectra:
        return (_white_pink(excitation.spectrum),) * drives
    if excitation.HasField("spectrum"):
        raise SettingError(
            "The excitation has one spectrum for all drives and one for each; give one of the two.",
            field="excitation.drive_spectra",
        )
    if len(excitation.drive_spectra) != drives:
        raise SettingError(
            f"The excitation has {len(excitation.drive_spectra)} spectra and {drives} levels; give one of each for "
            "every drive.",
            field="excitation.drive_spectra",
        )
    spectra: list[PowerSpectrum] = []
    for index, message in enumerate(excitation.drive_spectra):
        field = f"excitation.drive_spectra.{index}"
        try:
            spectra.append(_spectrum(message, field=field))
        except SettingError as error:
            # The shapes know only that they are wrong, not whose they are.
            raise SettingError(str(error), field=field) from error
    return tuple(spectra)


def _spectrum(message: identifier_pb2.Spectrum, *, field: str) -> PowerSpectrum:
    if message.WhichOneof("shape") == "table":
        return TabulatedSpectrum(
            frequencies=_values(message.table.frequency, field=f"{field}.table.frequency"),
            densities=_values(message.table.density, field=f"{field}.table.density"),
        )
    return _white_pink(message.white_pink)


def _white_pink(message: identifier_pb2.WhitePinkSpectrum) -> WhitePink:
    return WhitePink(
        lowest_frequency=message.lowest_frequency,
        highest_frequency=message.highest_frequency,
        corner_frequency=message.corner_frequency,
        decibels_per_octave=message.decibels_per_octave,
    )


def _values(array: array_pb2.Array, *, field: str) -> tuple[float, ...]:
    try:
        return tuple(from_array(array, field=field, shape=(None,), dtype=np.float64).tolist())
    except ArrayError as error:
        raise SettingError(str(error), field=error.field) from error


def _check_names(request: identifier_pb2.IdentifyRequest) -> None:
    for field, check, name in (("rig", check_rig, request.rig), ("run", check_run, request.run)):
        try:
            check(name)
        except ValueError as error:
            raise SettingError(str(error), field=field) from error
