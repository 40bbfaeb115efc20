"""An identified rig as a value, and as the contract's Model, named by the hash of its content."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from duralab_drive_map.messages import from_message as drive_map_from_message
from duralab_loads import DAMAGE_EXPONENTS
from duralab_proto.arrays import from_array, to_array
from duralab_proto.contents import content_hash
from duralab_proto.v1 import array_pb2, identifier_pb2
from identifier.uncertainty import ValidBand, element_variance


@dataclass(frozen=True)
class IdentifiedModel:
    """An identified rig: ``H`` in ``y(f) = H(f) u(f)``, with ``e^{+j omega t}``; fields as in `duralab.v1.Model`.

    Parameters
    ----------
    rig
        Name of the rig.
    drives, responses
        Inputs and outputs of ``H``, in order.
    sample_rate
        Sample rate in hertz.
    frequency
        Shape (lines), in hertz, from 0 to half the sample rate.
    frf
        Complex, shape (lines, responses, drives); 0 outside the band of the excitation, like the next two.
    coherence
        Shape (lines, responses), 0 to 1.
    condition_number
        Shape (lines), 1 or more in the band.
    residual_psd
        Shape (lines, responses), unit squared per Hz: unexplained by the drives; 0 outside the band, as the next.
    row_covariance
        Complex, shape (lines, drives, drives): covariance of a row of `frf` for a residual of 1.
    interpolated
        Shape (lines): lines at which all of the above was interpolated.
    band
        Valid band.
    drive_psd
        Shape (lines, drives), unit squared per Hz.
    response_psd
        Shape (lines, responses), unit squared per Hz.
    excitation, estimator
        As requested.
    blocks
        Number of averaged blocks (Eq. 10).
    independent_averages
        Equivalent independent averages.
    rig_content_hash
        Hash of the identified rig.
    run
        Playback of the identification.
    signal_epoch, signal_blocks
        Epoch and number of that playback's signal blocks.
    plan
        Duration and results of the experiment.
    warnings
        Warnings about the record and the estimate.
    verdicts
        Linearity of each response, as text.
    distortion
        Noise and nonlinear distortion separately; None if the experiment does not separate them.
    drive_map
        Change of drive coordinates for ``H``; None if not requested.
    response_damage
        Shape (responses, 3), unit^slope: pseudo-damage of each response over the whole run, as measured, for S-N lines
        of slope 3, 5 and 8; None in a model of an older recording.
    static_gain
        Shape (responses, drives), response unit per drive unit; None if the experiment does not measure it.
    static_change
        Shape (responses): change during the used half of the holds over the largest step; None if the experiment does
        not measure it, and in a model of an older recording.
    shaped_by
        Id of the model that shaped the experiment, whose static gain and damage are included; empty if none did.
    target_level
        RMS of the shaped responses over that of the target; 0 if the experiment was not shaped.
    id
        Hash of all other fields; empty before `with_id`.
    """

    rig: str
    drives: tuple[array_pb2.Channel, ...]
    responses: tuple[array_pb2.Channel, ...]
    sample_rate: float
    frequency: NDArray[np.float64]
    frf: NDArray[np.complex128]
    coherence: NDArray[np.float64]
    condition_number: NDArray[np.float64]
    residual_psd: NDArray[np.float64]
    row_covariance: NDArray[np.complex128]
    interpolated: NDArray[np.bool_]
    band: ValidBand
    drive_psd: NDArray[np.float64]
    response_psd: NDArray[np.float64]
    excitation: identifier_pb2.Excitation
    estimator: identifier_pb2.Estimator
    blocks: int
    independent_averages: float
    rig_content_hash: str
    run: str
    signal_epoch: int
    signal_blocks: int
    plan: identifier_pb2.ExperimentPlan
    warnings: tuple[identifier_pb2.ModelWarning, ...]
    verdicts: tuple[str, ...]
    distortion: identifier_pb2.Distortion | None
    drive_map: identifier_pb2.DriveMap | None = None
    response_damage: NDArray[np.float64] | None = None
    static_gain: NDArray[np.float64] | None = None
    static_change: NDArray[np.float64] | None = None
    shaped_by: str = ""
    target_level: float = 0.0
    id: str = ""

    def to_mapped(self, drive: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the input of ``H`` for a drive.

        Parameters
        ----------
        drive
            Shape (drives, samples), as a rig plays it.

        Returns
        -------
        NDArray
            Mapped drive of the same shape; the drive itself if there is no map.
        """
        if self.drive_map is None:
            return drive
        drive_map = drive_map_from_message(self.drive_map, drives=self.drives, sample_rate=self.sample_rate)
        return drive_map.to_mapped(drive)

    @property
    def frf_variance(self) -> NDArray[np.float64]:
        """Variance ``E|H - E H|^2`` of every element, shape (lines, responses, drives), unit of `frf` squared."""
        return element_variance(self.residual_psd, self.row_covariance)


def with_id(model: IdentifiedModel) -> IdentifiedModel:
    """Return a model with the hash of its content as its id.

    Parameters
    ----------
    model
        Model; its present id does not matter.

    Returns
    -------
    IdentifiedModel
        The model with its id.
    """
    return replace(model, id=content_hash(to_message(model)))


def to_message(model: IdentifiedModel) -> identifier_pb2.Model:
    """Encode a model.

    Parameters
    ----------
    model
        Model with or without an id.

    Returns
    -------
    identifier_pb2.Model
        Model as a message.
    """
    return identifier_pb2.Model(
        id=model.id,
        rig=model.rig,
        drives=model.drives,
        responses=model.responses,
        sample_rate=model.sample_rate,
        frequency=to_array(model.frequency),
        frf=to_array(model.frf),
        coherence=to_array(model.coherence),
        condition_number=to_array(model.condition_number),
        frf_variance=to_array(model.frf_variance),
        drive_psd=to_array(model.drive_psd),
        response_psd=to_array(model.response_psd),
        excitation=model.excitation,
        estimator=model.estimator,
        blocks=model.blocks,
        independent_averages=model.independent_averages,
        rig_content_hash=model.rig_content_hash,
        run=model.run,
        signal_epoch=model.signal_epoch,
        signal_blocks=model.signal_blocks,
        residual_psd=to_array(model.residual_psd),
        row_covariance=to_array(model.row_covariance),
        lowest_frequency=model.band.lowest,
        highest_frequency=model.band.highest,
        interpolated=model.interpolated.tolist() if model.interpolated.any() else (),
        warnings=model.warnings,
        distortion=model.distortion,
        plan=model.plan,
        verdicts=model.verdicts,
        drive_map=model.drive_map,
        response_damage=None if model.response_damage is None else to_array(model.response_damage),
        static_gain=None if model.static_gain is None else to_array(model.static_gain),
        static_change=None if model.static_change is None else to_array(model.static_change),
        shaped_by=model.shaped_by,
        target_level=model.target_level,
    )


def from_message(message: identifier_pb2.Model) -> IdentifiedModel:
    """Decode and validate a model.

    Parameters
    ----------
    message
        As received, untrusted.

    Returns
    -------
    IdentifiedModel
        Model whose arrays are read-only views of the message.

    Raises
    ------
    ValueError
        An array has a wrong shape or type, or the id is not the hash of the content.
    """
    n_u, n_y = len(message.drives), len(message.responses)
    frequency = from_array(message.frequency, field="frequency", shape=(None,), dtype=np.float64)
    lines = frequency.size
    expected = content_hash(message)
    if message.id != expected:
        raise ValueError(
            f"The model calls itself {message.id!r}, its content hashes to {expected!r}; it was damaged or changed."
        )
    return IdentifiedModel(
        id=message.id,
        rig=message.rig,
        drives=tuple(message.drives),
        responses=tuple(message.responses),
        sample_rate=message.sample_rate,
        frequency=frequency,
        frf=from_array(message.frf, field="frf", shape=(lines, n_y, n_u), dtype=np.complex128),
        coherence=from_array(message.coherence, field="coherence", shape=(lines, n_y), dtype=np.float64),
        condition_number=from_array(
            message.condition_number, field="condition_number", shape=(lines,), dtype=np.float64
        ),
        residual_psd=from_array(message.residual_psd, field="residual_psd", shape=(lines, n_y), dtype=np.float64),
        row_covariance=from_array(
            message.row_covariance, field="row_covariance", shape=(lines, n_u, n_u), dtype=np.complex128
        ),
        interpolated=_interpolated(message, lines),
        band=ValidBand(
            lowest=message.lowest_frequency,
            highest=message.highest_frequency,
            sample_rate=message.sample_rate,
            block_samples=2 * (lines - 1),
        ),
        drive_psd=from_array(message.drive_psd, field="drive_psd", shape=(lines, n_u), dtype=np.float64),
        response_psd=from_array(message.response_psd, field="response_psd", shape=(lines, n_y), dtype=np.float64),
        excitation=message.excitation,
        estimator=message.estimator,
        blocks=message.blocks,
        independent_averages=message.independent_averages,
        rig_content_hash=message.rig_content_hash,
        run=message.run,
        signal_epoch=message.signal_epoch,
        signal_blocks=message.signal_blocks,
        plan=message.plan,
        warnings=tuple(message.warnings),
        verdicts=tuple(message.verdicts),
        distortion=message.distortion if message.HasField("distortion") else None,
        drive_map=_drive_map(message),
        response_damage=_response_damage(message),
        static_gain=from_array(message.static_gain, field="static_gain", shape=(n_y, n_u), dtype=np.float64)
        if message.HasField("static_gain")
        else None,
        static_change=from_array(message.static_change, field="static_change", shape=(n_y,), dtype=np.float64)
        if message.HasField("static_change")
        else None,
        shaped_by=message.shaped_by,
        target_level=message.target_level,
    )


def _drive_map(message: identifier_pb2.Model) -> identifier_pb2.DriveMap | None:
    if not message.HasField("drive_map"):
        return None
    drive_map_from_message(message.drive_map, drives=message.drives, sample_rate=message.sample_rate)
    return message.drive_map


def _response_damage(message: identifier_pb2.Model) -> NDArray[np.float64] | None:
    if not message.HasField("response_damage"):
        return None
    shape = (len(message.responses), len(DAMAGE_EXPONENTS))
    return from_array(message.response_damage, field="response_damage", shape=shape, dtype=np.float64)


def _interpolated(message: identifier_pb2.Model, lines: int) -> NDArray[np.bool_]:
    if len(message.interpolated) not in (0, lines):
        raise ValueError(
            f"The model says of {len(message.interpolated)} lines whether they are interpolated; it has {lines} lines."
        )
    return np.array(message.interpolated, dtype=np.bool_) if message.interpolated else np.zeros(lines, dtype=np.bool_)
