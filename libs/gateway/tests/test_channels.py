"""Sensors and calculated channels of a configuration: units by pint, levels, and what is refused before serving."""

import re
from datetime import date

import numpy as np
import pytest
from pydantic import ValidationError
from rigs import Springs

from duralab_gateway import CalculatedChannel, ChannelTable, complete_description
from duralab_proto.arrays import from_array, to_array
from duralab_proto.channels import UNIT_OF_KIND, overdue_calibrations
from duralab_proto.v1 import array_pb2
from duralab_settings import SettingsError, UnitError, base_unit, parse_yaml, unit_conversion

TODAY = date(2026, 6, 1)
TABLE = """
sensors:
  a_force:
    serial_number: LC-4711
    sensitivity: 2.0
    sensitivity_unit: mV/V/kN
    calibration_date: 2026-01-15
    calibration_due: 2027-01-15
    minimum: -8000
    maximum: 9000
    polarity: positive
    drive: a_stroke
    warning_level: 5000
    abort_level: 7000
calculated:
  - {name: both, kind: force, sum: [a_force, b_force]}
  - {name: unlike, kind: force, difference: [a_force, b_force], warning_level: 900}
  - {name: roll, kind: moment, weights: {a_force: 750 mm, b_force: -0.75 m}, abort_level: 3000, label: about x}
"""


def table(text=TABLE):
    return ChannelTable.model_validate(parse_yaml(text))


def completed(text=TABLE, **described):
    told = complete_description(Springs(**described).describe())
    return told, table(text).complete(told, today=TODAY)


def test_a_table_completes_the_responses():
    told, description = completed(static_response=to_array(np.array([10.0, 4.0])))
    a, b, both, unlike, roll = description.responses
    assert (a.minimum, a.maximum) == (-8000.0, 9000.0)
    assert a.sensor == array_pb2.Sensor(
        serial_number="LC-4711",
        sensitivity=2.0,
        sensitivity_unit="mV/V/kN",
        calibration_date="2026-01-15",
        calibration_due="2027-01-15",
        minimum=-8000.0,
        maximum=9000.0,
        polarity=array_pb2.POLARITY_POSITIVE,
        drive="a_stroke",
        warning_level=5000.0,
        abort_level=7000.0,
    )
    assert not b.HasField("sensor")
    assert [channel.unit for channel in (both, unlike, roll)] == ["N", "N", "N*m"]
    assert [(term.channel, term.weight) for term in unlike.calculated] == [("a_force", 1.0), ("b_force", -1.0)]
    np.testing.assert_allclose([term.weight for term in roll.calculated], [0.75, -0.75], rtol=1e-12)
    # The range of a sum is that of its terms at their ends.
    assert (both.minimum, both.maximum) == (-18000.0, 19000.0)
    assert (unlike.minimum, unlike.maximum) == (-18000.0, 19000.0)
    assert (unlike.sensor.warning_level, roll.sensor.abort_level, roll.label) == (900.0, 3000.0, "about x")
    np.testing.assert_allclose(from_array(description.static_response), [10.0, 4.0, 14.0, 6.0, 4.5])
    assert description.content_hash != told.content_hash


def test_an_empty_table_changes_nothing():
    told, description = completed("{}")
    assert description == told


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("a_force:\n    serial", "c_force:\n    serial", "there is no response c_force; there are a_force, b_force."),
        ("2027-01-15", "2025-01-15", "calibration_due is 2025-01-15; it must be later than calibration_date, 2026"),
        ("2026-01-15", "2026-07-15", "calibration_date is 2026-07-15, and today is 2026-06-01"),
        ("maximum: 9000", "maximum: -9000", "the range of the sensor is -8000 to -9000 N; minimum must be below"),
        ("abort_level: 7000", "abort_level: 4000", "warning_level is 5000 N; it must be below abort_level, 4000 N"),
        ("abort_level: 7000", "abort_level: 9500", "abort_level is 9500 N, and the sensor measures up to 9000 N only"),
        ("mV/V/kN", "mV/V/mm", "sensitivity_unit is 'mV/V/mm', which times N is"),
        ("mV/V/kN", "furlong", "sensitivity_unit is 'furlong', which times N is"),
        ("mV/V/kN", "mV/V/kX", "The unit '(mV/V/kX)*(N)' of the sensitivity of a_force times N is not known"),
        ("    sensitivity: 2.0\n", "", "sensitivity and sensitivity_unit are given together or not at all"),
        ("drive: a_stroke", "drive: stroke", "drive is 'stroke'; the rig has a_stroke, b_stroke."),
        ("name: both", "name: a_force", "a_force is calculated, and exists already"),
        ("name: unlike", "name: both", "both is calculated, and exists already"),
        ("sum: [a_force, b_force]", "sum: [a_force, c]", "both is calculated from c; there are a_force, b_force."),
        ("750 mm", "750", "roll is a moment in 'N*m': a_force is in 'N', which cannot be converted to 'N*m'"),
        ("750 mm", "750 kg", "a_force is in 'kg*N', which cannot be converted to 'N*m'"),
        ("kind: force, sum", "kind: strain, sum", "both is a strain in '1': a_force is in 'N', which cannot"),
    ],
)
def test_what_does_not_fit_the_rig_is_one_sentence(old, new, sentence):
    assert old in TABLE
    with pytest.raises(ValueError, match=re.escape(sentence)):
        completed(TABLE.replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("2026-01-15", "soon", "sensors.a_force.calibration_date"),
        ("polarity: positive", "polarity: up", "sensors.a_force.polarity"),
        ("minimum: -8000", "", "sensors.a_force"),
        ("warning_level: 5000", "warning_level: -5", "sensors.a_force.warning_level"),
        ("serial_number", "serial", "sensors.a_force.serial"),
        ("sum: [a_force, b_force]", "sum: [a_force], difference: [a_force, b_force]", "calculated.0"),
        ("sum: [a_force, b_force]", "sum: [a_force, a_force]", "calculated.0"),
        (", sum: [a_force, b_force]", "", "calculated.0"),
        ("750 mm", "lots", "calculated.2"),
        ("750 mm", "0 mm", "calculated.2"),
        ("kind: moment", "kind: torque", "calculated.2.kind"),
        ("name: both", "name: Both Forces", "calculated.0.name"),
    ],
)
def test_what_a_key_cannot_be_is_found_where_it_is_read(old, new, place):
    assert old in TABLE
    with pytest.raises(ValidationError) as caught:
        table(TABLE.replace(old, new, 1))
    assert ".".join(map(str, caught.value.errors()[0]["loc"])) == place


def test_units_of_sensors_are_those_of_their_certificates():
    for kind, unit in (("force", "pC/N"), ("acceleration", "mV/g"), ("strain", "mV/V/ustrain"), ("angle", "mV/deg")):
        sensor = f"{{sensitivity: 1.0, sensitivity_unit: {unit}}}"
        told = Springs().describe()
        told.responses[0].unit = UNIT_OF_KIND[getattr(array_pb2, f"CHANNEL_KIND_{kind.upper()}")]
        table(f"sensors: {{a_force: {sensor}}}").complete(complete_description(told), today=TODAY)


def test_every_kind_has_a_unit():
    assert set(UNIT_OF_KIND) == set(array_pb2.ChannelKind.values()) - {array_pb2.CHANNEL_KIND_UNSPECIFIED}


def test_units_convert_and_angles_are_no_strains():
    assert unit_conversion("kN", "N", "f") == (1000.0, 0.0)
    assert unit_conversion("mm", "m", "x") == (0.001, 0.0)
    factor, offset = unit_conversion("degC", "K", "t")
    assert (factor, offset) == pytest.approx((1.0, 273.15))
    assert base_unit("deg", "a") == base_unit("rad", "a") != base_unit("ustrain", "a")
    assert unit_conversion("N", "N*m", "f", times="mm") == (0.001, 0.0)
    with pytest.raises(UnitError, match="one is measured in"):
        unit_conversion("N", "m", "f")
    with pytest.raises(UnitError, match="names no unit"):
        base_unit(" ", "f")


def test_zeros_of_units_are_not_added():
    calculated = CalculatedChannel(name="warm", kind="ratio", sum=("t",))
    with pytest.raises(SettingsError, match="cannot be converted"):
        calculated.factors({"t": "degC"})


def test_an_overdue_calibration_is_named_with_its_days():
    _, description = completed()
    assert overdue_calibrations(description.responses, today=TODAY) == []
    assert len(overdue_calibrations(description.responses, today=date(2027, 1, 15))) == 1
    assert overdue_calibrations(description.responses, today=date(2027, 1, 14)) == []
    (sentence,) = overdue_calibrations(description.responses, today=date(2027, 1, 25))
    assert sentence == (
        "The calibration of a_force (LC-4711) is overdue since 2027-01-15, for 10 days; calibrate the sensor, or take "
        "its figures with care."
    )
    # From a gateway that is not of this library.
    description.responses[0].sensor.calibration_due = "soon"
    (sentence,) = overdue_calibrations(description.responses, today=TODAY)
    assert sentence.startswith("The calibration of a_force (LC-4711) is due 'soon', which is no date;")
