"""Whatever is wrong with a drive is said in one sentence with the value and what is allowed."""

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_gateway import Approach
from duralab_gateway.description import check_drive
from duralab_proto.v1 import array_pb2, rig_pb2
from rig_sim import shipped_specimens
from rig_sim.bus import _drive_channel
from rig_sim.specimen.specimen import Specimen, read_specimen
from rig_sim.structure.specimen import StructureSpecimen

NAMES = ["left_vertical", "left_lateral", "left_longitudinal", "right_vertical", "right_lateral", "right_longitudinal"]
UNITS = ["m"] * 6


def drive(samples=500):
    return np.zeros((6, samples))


def spoiled(row, sample, value):
    given = drive()
    given[row, sample] = value
    return given


def ramp(row, share, specimen):
    """Return a drive in which one channel moves at a share of its slew limit."""
    given = drive()
    given[row] = np.minimum(np.arange(500) * share * specimen.drives[row].slew_limit / 1000.0, 0.05)
    return given


def check(specimen, **changes):
    given = {"names": NAMES, "units": UNITS, "sample_rate": 1000.0, "drive": drive()} | changes
    check_against(specimen, given["names"], given["units"], given["sample_rate"], given["drive"])


def check_against(specimen, names, units, sample_rate, drive):
    description = rig_pb2.RigDescription(
        rig=specimen.name,
        sample_rate=specimen.sample_rate,
        longest_drive_seconds=specimen.longest_drive,
        drives=[_drive_channel(channel) for channel in specimen.drives],
    )
    channels = [array_pb2.Channel(name=name, unit=unit) for name, unit in zip(names, units, strict=False)]
    check_drive(description, channels, sample_rate, drive, steps_in=specimen.approach.ramp == 0.0)


def test_a_good_drive_passes(front_axle):
    check(front_axle.specimen)
    limits = np.array([[c.minimum, c.maximum] for c in front_axle.specimen.drives])
    both = np.outer(limits[:, 1], np.sin(2 * np.pi * np.arange(4000) / 4000))
    check(front_axle.specimen, drive=np.where(both > 0, both, -both / limits[:, 1:] * limits[:, :1]))
    check(front_axle.specimen, drive=ramp(0, 0.999, front_axle.specimen))


@pytest.mark.parametrize(
    ("changes", "field", "said"),
    [
        ({"sample_rate": 512.0}, "drive.sample_rate", ["512 Hz", "front_axle plays 1000 Hz only", "resample"]),
        ({"names": NAMES[:3]}, "drive.channels", ["3 channels (left_vertical, ", "takes 6 in this order"]),
        ({"names": []}, "drive.channels", ["0 channels (none)"]),
        ({"names": NAMES[::-1]}, "drive.channels", ["in this order: left_vertical, left_lateral"]),
        (
            {"units": ["m", "mm", "m", "m", "in", "m"]},
            "drive.channels",
            ["left_lateral is in 'mm' instead of 'm'", "right_lateral is in 'in' instead of 'm'"],
        ),
        ({"drive": np.zeros((5, 10))}, "drive.samples", ["shape (5, 10)", "takes (6, samples)"]),
        ({"drive": np.zeros(10)}, "drive.samples", ["shape (10,)", "takes (6, samples)"]),
        ({"drive": drive(0)}, "drive.samples", ["0 samples", "1 to 3600000 (3600 s)"]),
        ({"drive": np.zeros((6, 3_600_001))}, "drive.samples", ["3600001 samples", "1 to 3600000 (3600 s)"]),
        ({"drive": spoiled(3, 17, np.nan)}, "drive.samples", ["right_vertical is nan at sample 17", "finite"]),
        ({"drive": spoiled(1, 0, -np.inf)}, "drive.samples", ["left_lateral is -inf at sample 0"]),
        (
            {"drive": spoiled(0, 250, 0.1151)},
            "drive.samples",
            ["left_vertical is 0.1151 m at 0.250 s", "allowed -0.115 to 0.115"],
        ),
        ({"drive": spoiled(4, 499, -0.0651)}, "drive.samples", ["right_lateral is -0.0651 m at 0.499 s"]),
    ],
)
def test_a_bad_drive_is_refused_with_value_and_limit(front_axle, changes, field, said):
    with pytest.raises(FaultError) as caught:
        check(front_axle.specimen, **changes)
    assert (caught.value.code_name, caught.value.field) == ("INVALID_ARGUMENT", field)
    message = str(caught.value)
    assert message.endswith(".")
    assert "\n" not in message
    for part in said:
        assert part in message


def test_a_drive_that_is_too_fast_is_refused(front_axle):
    limit = front_axle.specimen.drives[4].slew_limit
    with pytest.raises(FaultError) as caught:
        check(front_axle.specimen, drive=ramp(4, 1.01, front_axle.specimen))
    assert f"right_lateral moves at {1.01 * limit:.3g} m/s" in str(caught.value)
    assert str(caught.value).endswith(f"allowed {limit:g}.")


def test_a_drive_may_begin_and_end_anywhere_within_its_limits(front_axle):
    check(front_axle.specimen, drive=np.full((6, 100), 0.003))


def test_the_first_sample_is_a_step_from_zero_where_the_rig_has_no_ramp(front_axle):
    blunt = front_axle.specimen.model_copy(update={"approach": Approach(ramp=0.0)})
    with pytest.raises(FaultError, match=r"left_lateral moves at 3 m/s at 0\.000 s"):
        check(blunt, drive=np.full((6, 100), 0.003))


def test_all_channels_beyond_their_limits_are_named_at_once(front_axle):
    given = spoiled(0, 5, 1.0)
    given[3, 7] = -2.0
    with pytest.raises(FaultError, match=r"left_vertical is 1 m at 0\.005 s.*; right_vertical is -2 m at 0\.007 s"):
        check(front_axle.specimen, drive=given)


def test_a_channel_without_slew_limit_may_step(predecessor):
    specimen = predecessor.specimen
    names, units = [c.name for c in specimen.drives], [c.unit for c in specimen.drives]
    check_against(specimen, names, units, 1000.0, np.full((8, 100), 0.05))


@pytest.mark.parametrize(
    ("rig", "row", "change", "said"),
    [
        ("spindle_coupled", 0, 0.101, "left_vertical is 0.101 m at 0.100 s, allowed -0.1 to 0.1"),
        ("spindle_coupled", 0, 0.005, "left_vertical moves at 5 m/s at 0.100 s, allowed 4"),
        ("spindle_coupled", 1, 1.3e4, "left_lateral is 1.3e+04 N at 0.100 s, allowed -12000 to 12000"),
        ("spindle_coupled", 1, 2.0e3, "left_lateral moves at 2e+06 N/s at 0.100 s, allowed 1e+06"),
        ("predecessor", 3, 61.0, "left_speed is 61 m/s at 0.100 s, allowed 0 to 60"),
        ("aerospace", 1, -21.0, "right_wing is -21 N at 0.195 s, allowed -20 to 20"),
    ],
    ids=["stroke", "velocity", "force", "slew", "speed", "shaker"],
)
def test_before_it_plays_a_drive_is_held_to_stroke_velocity_force_and_slew(rig, row, change, said):
    path = shipped_specimens()[rig]
    specimen = read_specimen(path, StructureSpecimen if rig == "aerospace" else Specimen)
    drive = np.zeros((len(specimen.drives), 200))
    drive[row, 100:] = change
    names, units = [c.name for c in specimen.drives], [c.unit for c in specimen.drives]
    with pytest.raises(FaultError) as caught:
        check_against(specimen, names, units, specimen.sample_rate, drive)
    assert str(caught.value) == f"the drive is beyond the limits of {rig}: {said}."


@pytest.mark.parametrize("name", sorted(shipped_specimens()))
def test_displacement_control_states_that_it_holds_a_constant_value_and_force_control_does_not(name):
    specimen = StructureSpecimen if name == "aerospace" else Specimen
    drives = [_drive_channel(channel) for channel in read_specimen(shipped_specimens()[name], specimen).drives]
    assert [drive.holds_static for drive in drives] == [drive.unit == "m" for drive in drives]


@pytest.mark.parametrize(
    "name", ["front_axle", "front_axle_compliant", "macpherson", "macpherson_compliant", "spindle_coupled"]
)
def test_an_actuator_states_the_speed_of_its_open_valve_under_some_load(name):
    """Without a load each land drops half the supply's pressure (Merritt, Hydraulic Control Systems)."""
    specimen = read_specimen(shipped_specimens()[name], Specimen)
    kinds = {part.name: specimen.actuator_kinds[part.kind] for part in specimen.actuators}
    stated = [_drive_channel(channel) for channel in specimen.drives if channel.actuator_speed > 0.0]
    assert [channel.name for channel in stated] == ["left_vertical", "right_vertical"]
    for channel in stated:
        valve, cylinder = kinds[channel.name].valve, kinds[channel.name].cylinder
        drop = (specimen.supply.supply_pressure - specimen.supply.return_pressure) / 2.0
        free = valve.rated_flow * np.sqrt(drop / valve.rated_drop) / cylinder.area
        # The wheel and its spring take an eighth of the pressure at most: 1 - 1/8 of it leaves 0.94 of the speed.
        assert 0.93 * free < channel.actuator_speed < free < channel.slew_limit
