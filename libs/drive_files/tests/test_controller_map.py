"""A controller map converts both ways and is one-to-one; what cannot be is refused in one sentence."""

from datetime import date

import numpy as np
import pytest

from duralab_drive_files import DriveFileError, TimeHistory, moments_about, read_controller_map, wheel_force_signs

MAP = """
rig: front_axle
controller: MTS 793, station 3
sample_rate: 256
controller_rate: 512
lead: 1.5
drives:
  left_vertical:
    channel: LF Vert Disp
    kind: displacement
    unit: mm
    sign: -1
    factor: 2
    offset: 10
    minimum: -75
    maximum: 75
    slew_limit: 2000
    actuator_speed: 1200
    recorded_command: LF Vert Disp Cmd
  left_lateral:
    channel: LF Lat Force
    kind: force
    unit: kN
    minimum: -20
    maximum: 10
    full_scale: 25
responses:
  left_spindle:
    channel: LF Spindle Accel
    kind: acceleration
    unit: g
    sign: -1
    minimum: -50
    maximum: 50
  left_pressure:
    channel: LF Pressure
    kind: pressure
    unit: bar
    minimum: 0
    maximum: 280
wheel_forces:
  right:
    convention: swift_right
    channels: {fx: RF Fx, fy: RF Fy, fz: RF Fz, mx: RF Mx, my: RF My, mz: RF Mz}
    force_unit: kN
    moment_unit: kN*m
    force_range: 50
    moment_range: 10
    offset: [0, -0.1, 0]
channels:
  sensors:
    left_spindle: {serial_number: A-1, calibration_date: 2026-01-10, calibration_due: 2027-01-10}
  calculated:
    - {name: pitch, kind: moment, weights: {right_fx: 0.3 m, right_my: 1}}
"""


@pytest.fixture
def read(tmp_path):
    """Return a function that reads the map with replaced texts."""

    def reader(*changes):
        text = MAP
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "map.yaml"
        path.write_text(text, encoding="utf-8")
        return read_controller_map(path)

    return reader


def history(names, units, samples):
    return TimeHistory(tuple(names), tuple(units), 512.0, np.array(samples, dtype=np.float64))


def controller_file(mapped, response, units=None):
    """Return the file of a controller that measured a response."""
    names = [channel.controller_channel for channel in mapped.responses]
    own = [channel.controller_unit for channel in mapped.responses]
    return history(names, units or own, mapped.responses_to_controller(response))


def test_a_drive_goes_into_the_units_signs_and_offsets_of_the_controller(read):
    mapped = read()
    # By hand: -2 * (1000 mm/m * 0.01 m) + 10 mm, and N in kN.
    np.testing.assert_allclose(mapped.drives_to_controller(np.array([[0.01], [5000.0]])), [[-10.0], [5.0]])
    vertical, lateral = mapped.drives
    # -75 mm = -2 * 42.5 mm + 10 mm.
    assert (vertical.minimum, vertical.maximum) == pytest.approx((-0.0325, 0.0425))
    assert vertical.slew_limit == pytest.approx(1.0)
    assert (vertical.actuator_speed, lateral.actuator_speed) == pytest.approx((0.6, 0.0))
    assert vertical.to_message().actuator_speed == vertical.actuator_speed
    assert (vertical.full_scale, lateral.full_scale) == pytest.approx((75.0, 25.0))
    assert mapped.recorded_commands == {"left_vertical": "LF Vert Disp Cmd"}
    assert (mapped.lead_seconds, mapped.exchange.name) == (1.5, "exchange")


def test_a_drive_file_in_other_units_comes_back_as_the_drive(read):
    mapped = read()
    drive = np.random.default_rng(3).uniform(-0.03, 0.03, size=(2, 50))
    in_mm, in_kn = mapped.drives_to_controller(drive)
    found = history(["other", "LF Lat Force", "LF Vert Disp"], ["V", "N", "m"], [in_mm, in_kn * 1e3, in_mm / 1e3])
    np.testing.assert_allclose(mapped.drives_from_controller(found), drive, rtol=1e-12, atol=1e-15)
    recorded = history(["LF Vert Disp Cmd"], [""], [in_mm])
    commands = mapped.commands_from_controller(recorded)
    assert list(commands) == ["left_vertical"]
    np.testing.assert_allclose(commands["left_vertical"], drive[0], rtol=1e-12, atol=1e-15)


def test_responses_come_back_whatever_unit_the_file_names(read):
    mapped = read()
    response = np.random.default_rng(4).normal(size=(8, 60))
    np.testing.assert_allclose(mapped.responses_from_controller(controller_file(mapped, response)), response)
    found = controller_file(mapped, response)
    # 1 g is 9.80665 m/s^2 by definition, and the channel is inverted.
    np.testing.assert_allclose(found.samples[0] * -9.80665, response[0], rtol=1e-12)
    found.samples[1] *= 1e5
    units = ("g", "Pa", *found.units[2:])
    changed = TimeHistory(found.names, units, found.sample_rate, found.samples)
    np.testing.assert_allclose(mapped.responses_from_controller(changed), response)


def test_the_right_wheel_is_turned_about_the_vertical_and_its_moments_are_moved(read):
    mapped = read()
    # Pushed up by 1 kN at the centre of a wheel: about a point 0.1 m to its right the moment about x is +100 N m.
    names = [channel.controller_channel for channel in mapped.responses]
    samples = np.zeros((8, 1))
    samples[names.index("RF Fz")] = 1.0
    found = mapped.responses_from_controller(
        history(names, [each.controller_unit for each in mapped.responses], samples)
    )
    np.testing.assert_allclose(found[2:, 0], [0, 0, 1000.0, 100.0, 0, 0], atol=1e-9)
    # Out of the vehicle is to the right here, y points to the left, and forwards by the right hand is backwards.
    assert wheel_force_signs("swift_right") == (-1, -1, 1, -1, -1, 1)
    assert wheel_force_signs("swift_left") == wheel_force_signs("iso_8855") == (1, 1, 1, 1, 1, 1)


@pytest.mark.parametrize("convention", ["iso_8855", "swift_left", "swift_right"])
def test_every_convention_is_right_handed_so_that_moments_are_those_of_the_forces(convention):
    signs = np.array(wheel_force_signs(convention))
    rng = np.random.default_rng(5)
    arm, force = rng.normal(size=3), rng.normal(size=3)
    # A force at an arm, seen in the transducer's axes, has the moment of the transducer's axes.
    np.testing.assert_allclose(np.cross(signs[:3] * arm, signs[:3] * force), signs[3:] * np.cross(arm, force))


def test_moments_about_the_point_of_a_force_are_zero():
    rng = np.random.default_rng(6)
    point, forces = rng.normal(size=3), rng.normal(size=(3, 20))
    moments = np.cross(point, forces, axisb=0, axisc=0)
    np.testing.assert_allclose(moments_about(forces, moments, point), 0.0, atol=1e-14)


def test_the_description_has_the_ranges_of_the_lab_and_the_calculated_channel_its_factor(read):
    mapped = read()
    description = mapped.channels.complete(mapped.description(), today=date(2026, 6, 1))
    assert [channel.name for channel in description.responses][-2:] == ["right_mz", "pitch"]
    assert description.responses[1].maximum == pytest.approx(280e5)
    assert mapped.channels.rows(description) == [{2: 0.3, 6: 1.0}]
    assert description.publishes_after_run
    assert not description.simulated


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("channel: LF Lat Force", "channel: LF Vert Disp", "LF Vert Disp more than once; the map must be one-to-one"),
        ("channel: LF Pressure", "channel: LF Spindle Accel", "one-to-one"),
        ("recorded_command: LF Vert Disp Cmd", "recorded_command: LF Pressure", "one-to-one"),
        ("mz: RF Mz", "mz: RF My", "one-to-one"),
        ("  left_pressure:", "  right_fx:", "responses name right_fx more than once"),
        ("unit: bar", "unit: kN", "cannot be converted to 'Pa'"),
        ("unit: bar", "unit: furlongish", "The unit 'furlongish' of left_pressure is not known"),
        ("moment_unit: kN*m", "moment_unit: kN", "cannot be converted to 'N*m'"),
        ("    kind: pressure", "    kind: presure", "kind is 'presure'; displacement, force"),
        ("minimum: -75", "minimum: 75", "minimum is 75 and maximum 75; minimum must be below"),
        ("minimum: -75", "minimum: 20", "a rig rests at 0"),
        ("minimum: -75", "minimum: .nan", "drives.left_vertical.minimum is nan; it must be a finite number"),
        ("full_scale: 25", "full_scale: 15", "full_scale is 15 kN, and the limits reach 20 kN"),
        ("full_scale: 25", "full_scale: 0", "full_scale is 0; it must be greater than 0"),
        ("slew_limit: 2000", "slew_limit: -1", "slew_limit is -1; it must be greater than 0"),
        ("actuator_speed: 1200", "actuator_speed: 0", "actuator_speed is 0; it must be greater than 0"),
        ("factor: 2", "factor: 0", "factor is 0; it must be greater than 0"),
        ("sign: -1", "sign: 2", "sign is 2; allowed: 1, -1"),
        ("convention: swift_right", "convention: swift", "convention is 'swift'; allowed: 'iso_8855', 'swift_left'"),
        (", mz: RF Mz}", "}", "offset needs all of fx"),
        ("calibration_due: 2027-01-10", "calibration_due: 2026-01-09", "must be later than calibration_date"),
        ("calibration_date: 2026-01-10", "calibration_date: 2226-01-10", "calibration_date is 2226-01-10, and today"),
        ("    left_spindle: {", "    left_spindel: {", "there is no response left_spindel"),
        ("right_fx: 0.3 m", "right_fx: 0.3", "which cannot be converted to 'N*m'"),
        ("right_fx: 0.3 m", "right_fz_: 0.3 m", "pitch is calculated from right_fz_"),
        ("lead: 1.5", "lead: 0", "lead is 0; it must be greater than 0"),
        ("lead: 1.5", "leed: 1.5", "unknown key 'leed'"),
        ("rig: front_axle", "rig: Front Axle", "Front Axle"),
        ("rig: front_axle", "rig: front_axle\nrig: b", "the key 'rig' is given twice"),
        ("rig: front_axle", "rig: [", "it is not YAML"),
        ("channel: LF Pressure", "channel: Ωmega", "it must be a text of printable Latin-1 characters"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence_with_the_file(read, tmp_path, old, new, said):
    with pytest.raises(DriveFileError) as caught:
        read((old, new))
    sentence = str(caught.value)
    assert said in sentence
    assert sentence.startswith(f"{tmp_path / 'map.yaml'}: ")
    assert sentence.endswith((".", "?"))
    assert "\n" not in sentence


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"- 1", b"12"])
def test_what_is_no_map_is_refused(tmp_path, content):
    path = tmp_path / "map.yaml"
    path.write_bytes(content)
    with pytest.raises(DriveFileError, match=r"map\.yaml"):
        read_controller_map(path)
    with pytest.raises(DriveFileError, match=r"it cannot be read \(No such file"):
        read_controller_map(tmp_path / "other.yaml")


def test_a_file_without_the_channels_of_the_map_or_with_two_of_a_name_is_refused(read):
    mapped = read()
    found = controller_file(mapped, np.ones((8, 4)))
    fewer = TimeHistory(found.names[2:], found.units[2:], 512.0, found.samples[2:])
    with pytest.raises(DriveFileError, match="lacks the channels LF Spindle Accel, LF Pressure; it has RF Fx"):
        mapped.responses_from_controller(fewer)
    labels = ("RF Fx", *found.names[1:])
    with pytest.raises(DriveFileError, match="lacks the channels LF Spindle Accel"):
        mapped.responses_from_controller(TimeHistory(found.names, found.units, 512.0, found.samples, labels=labels))
    twice = TimeHistory(
        (*found.names, "x"), (*found.units, "kN"), 512.0, np.ones((9, 4)), labels=(*found.names, "RF Fx")
    )
    with pytest.raises(DriveFileError, match="'RF Fx' is in it 2 times"):
        mapped.responses_from_controller(twice)
    with pytest.raises(DriveFileError, match=r"cannot be converted to 'bar'.*correct the map"):
        mapped.responses_from_controller(controller_file(mapped, np.ones((8, 4)), ["g", "V", *found.units[2:]]))
