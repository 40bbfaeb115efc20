"""Sensors of a rig's responses, with the data of the calibration certificate."""

from __future__ import annotations

from dataclasses import dataclass, replace

from duralab_proto.v1 import array_pb2


@dataclass(frozen=True)
class Sensor:
    """Sensor of a response; 0 and empty strings mean "not stated".

    Parameters
    ----------
    serial_number : str
        Serial number on the calibration certificate.
    sensitivity : float
        Output per measured quantity.
    sensitivity_unit : str
        Unit of the sensitivity, e.g. "mV/V/kN".
    calibration_date, calibration_due : str
        Day of the calibration, and day from which it is overdue, as YYYY-MM-DD.
    minimum, maximum : float
        Calibrated range, in the unit of the channel.
    polarity : int
        Sign of the response to its drive: 1, -1, or 0.
    warning_level, abort_level : float
        Magnitude that is reported, and magnitude that ends a run and latches the rig, in the unit of the channel.
    drive : str
        Drive that moves the response most.
    """

    serial_number: str = ""
    sensitivity: float = 0.0
    sensitivity_unit: str = ""
    calibration_date: str = ""
    calibration_due: str = ""
    minimum: float = 0.0
    maximum: float = 0.0
    polarity: int = 0
    warning_level: float = 0.0
    abort_level: float = 0.0
    drive: str = ""

    @classmethod
    def from_message(cls, message: array_pb2.Sensor) -> Sensor:
        """Decode a sensor."""
        values = {name: getattr(message, name) for name in cls.__dataclass_fields__ if name != "polarity"}
        signs = {array_pb2.POLARITY_POSITIVE: 1, array_pb2.POLARITY_NEGATIVE: -1}
        return cls(**values, polarity=signs.get(message.polarity, 0))

    def to_message(self) -> array_pb2.Sensor:
        """Encode the sensor."""
        polarity = (array_pb2.POLARITY_UNSPECIFIED, array_pb2.POLARITY_POSITIVE, array_pb2.POLARITY_NEGATIVE)
        return array_pb2.Sensor(**{**vars(self), "polarity": polarity[self.polarity]})

    def scaled(self, factor: float, offset: float) -> Sensor:
        """Return the sensor with range and levels converted to another unit of its channel."""
        ranged = self.minimum or self.maximum
        return replace(
            self,
            minimum=self.minimum * factor + offset if ranged else 0.0,
            maximum=self.maximum * factor + offset if ranged else 0.0,
            warning_level=self.warning_level * factor,
            abort_level=self.abort_level * factor,
        )
