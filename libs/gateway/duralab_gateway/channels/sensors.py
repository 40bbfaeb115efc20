"""Sensor of a response: its configuration and the check of its values."""

from __future__ import annotations

from datetime import date, datetime
from enum import StrEnum
from math import isfinite
from typing import Final, Self

from pydantic import Field, model_validator

from duralab_proto.v1 import array_pb2
from duralab_settings import Positive, Section, UnitError, base_unit

_OUTPUTS: Final = ("V", "C", "A", "ohm", "Hz", "1")
"""Units of sensor outputs: voltage, charge, current, resistance, frequency, or a ratio such as mV/V or counts."""


class Polarity(StrEnum):
    """Sign of a response while the drive that moves it is positive."""

    POSITIVE = "positive"
    NEGATIVE = "negative"


class SensorSettings(Section):
    """Sensor of a response; values that are not stated are left out."""

    serial_number: str = Field(default="", max_length=100, description="As on the calibration certificate.")
    sensitivity: Positive | None = Field(default=None, description="Output over what is measured.")
    sensitivity_unit: str = Field(default="", description="Unit of the sensitivity, e.g. mV/V/kN.")
    calibration_date: date | None = Field(default=None, strict=False, description="Day of the calibration.")
    calibration_due: date | None = Field(default=None, strict=False, description="Day from which it is overdue.")
    minimum: float | None = Field(default=None, description="Calibrated range, in the unit of the channel.")
    maximum: float | None = Field(default=None, description="Calibrated range, in the unit of the channel.")
    polarity: Polarity | None = Field(default=None, strict=False, description="Sign of the response to `drive`.")
    drive: str = Field(default="", description="Drive that moves the response most.")
    warning_level: Positive | None = Field(default=None, description="Magnitude that is reported as a warning.")
    abort_level: Positive | None = Field(default=None, description="Magnitude that stops and latches the rig.")

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if (self.minimum is None) != (self.maximum is None):
            raise ValueError("has one of minimum and maximum; give both, or none")
        return self

    def to_message(self) -> array_pb2.Sensor:
        """Return it as a message, not checked; see `check_sensor`."""
        return array_pb2.Sensor(
            serial_number=self.serial_number,
            sensitivity=self.sensitivity or 0.0,
            sensitivity_unit=self.sensitivity_unit,
            calibration_date=self.calibration_date.isoformat() if self.calibration_date else "",
            calibration_due=self.calibration_due.isoformat() if self.calibration_due else "",
            minimum=self.minimum or 0.0,
            maximum=self.maximum or 0.0,
            polarity=getattr(array_pb2, f"POLARITY_{self.polarity.name if self.polarity else 'UNSPECIFIED'}"),
            drive=self.drive,
            warning_level=self.warning_level or 0.0,
            abort_level=self.abort_level or 0.0,
        )


def check_sensor(channel: array_pb2.Channel, *, drives: tuple[str, ...], today: date) -> None:
    """Check the sensor of a response.

    Parameters
    ----------
    channel : array_pb2.Channel
        Response with its sensor, if any; a range of zeros counts as not stated.
    drives : tuple of str
        Names of the rig's drives.
    today : date
        Present day; no calibration may be later.

    Raises
    ------
    ValueError
        If a date, the range, a level, the sensitivity or the drive is not possible; one sentence.
    """
    if not channel.HasField("sensor"):
        return
    sensor, name, unit = channel.sensor, channel.name, channel.unit
    _check_dates(sensor, name, today)
    numbers = (sensor.minimum, sensor.maximum, sensor.warning_level, sensor.abort_level, sensor.sensitivity)
    if not all(map(isfinite, numbers)) or min(numbers[2:]) < 0.0:
        raise ValueError(
            f"{name}: range, levels and sensitivity are {numbers}; they must be finite, the last three ≥ 0."
        )
    ranged = sensor.minimum != 0.0 or sensor.maximum != 0.0
    if ranged and not sensor.minimum < sensor.maximum:
        raise ValueError(
            f"{name}: the range of the sensor is {sensor.minimum:g} to {sensor.maximum:g} {unit}; minimum must be "
            "below maximum, give both."
        )
    reach = max(-sensor.minimum, sensor.maximum) if ranged else max(-channel.minimum, channel.maximum)
    if sensor.abort_level > 0.0 and sensor.warning_level >= sensor.abort_level:
        raise ValueError(
            f"{name}: warning_level is {sensor.warning_level:g} {unit}; it must be below abort_level, "
            f"{sensor.abort_level:g} {unit}."
        )
    for key, level in (("abort_level", sensor.abort_level), ("warning_level", sensor.warning_level)):
        if level > reach:
            raise ValueError(
                f"{name}: {key} is {level:g} {unit}, and the sensor measures up to {reach:g} {unit} only; lower the "
                "level, or take another sensor."
            )
    if bool(sensor.sensitivity) != bool(sensor.sensitivity_unit):
        raise ValueError(f"{name}: sensitivity and sensitivity_unit are given together or not at all.")
    if sensor.sensitivity_unit:
        _check_sensitivity_unit(sensor.sensitivity_unit, name, unit)
    if sensor.drive and sensor.drive not in drives:
        raise ValueError(f"{name}: drive is {sensor.drive!r}; the rig has {', '.join(drives)}.")


def _check_dates(sensor: array_pb2.Sensor, name: str, today: date) -> None:
    dates = {}
    for key in ("calibration_date", "calibration_due"):
        text = getattr(sensor, key)
        try:
            dates[key] = datetime.strptime(text, "%Y-%m-%d").date() if text else None
        except ValueError as error:
            raise ValueError(f"{name}: {key} is {text!r}; give a date as YYYY-MM-DD.") from error
    done, due = dates["calibration_date"], dates["calibration_due"]
    if done is not None and done > today:
        raise ValueError(f"{name}: calibration_date is {done}, and today is {today}; give the day that it was made.")
    if done is not None and due is not None and due <= done:
        raise ValueError(f"{name}: calibration_due is {due}; it must be later than calibration_date, {done}.")


def _check_sensitivity_unit(text: str, name: str, unit: str) -> None:
    try:
        output = base_unit(f"({text})*({unit})", f"the sensitivity of {name} times {unit}")
        outputs = {base_unit(each, each) for each in _OUTPUTS}
    except UnitError as error:
        raise ValueError(f"{name}: sensitivity_unit is {text!r}; {error}") from error
    if output not in outputs:
        raise ValueError(
            f"{name}: sensitivity_unit is {text!r}, which times {unit} is {output}; a sensor of {unit} has a unit such "
            f"as mV/({unit}), pC/({unit}) or mV/V/({unit})."
        )
