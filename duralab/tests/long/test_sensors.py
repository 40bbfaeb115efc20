"""Sensors from a rig to scripts and commands: warnings, overdue calibrations, tables, calculated channels."""

import json

import numpy as np
import pytest
from test_command_line import invoke

from duralab.campaign import EstimatorSettings, ExcitationSettings
from duralab.conformance import Outcome
from duralab.data import Channel, Sensor, Signals
from duralab.errors import InputError
from duralab.formats import add_calculated, convert_units
from duralab.testing import LinearRig, check_contract, lab
from duralab_gateway import CalculatedChannel
from duralab_proto.v1 import array_pb2

DRIVE = 1.0e-3 * np.sin(np.linspace(0.0, 60.0, 2000)) * np.ones((2, 1))
OVERDUE = "The calibration of force_2 (LC-9) is overdue since 2021-05-01"


def equipped(**levels):
    rig = LinearRig(noise_rms=1.0)
    sensor = array_pb2.Sensor(serial_number="LC-9", calibration_due="2021-05-01", **levels)
    rig.responses[1].sensor.CopyFrom(sensor)
    return rig


def test_warnings_reach_scripts_and_overdue_calibrations_the_table_of_rigs(tmp_path):
    excitation = ExcitationSettings(
        kind="pure_random",
        rms=0.001,
        duration=8.0,
        lowest_frequency=1.0,
        highest_frequency=100.0,
        corner_frequency=20.0,
        decibels_per_octave=3.0,
        fade=0.5,
    )
    with lab(equipped(warning_level=20.0, abort_level=5e3), out=tmp_path) as started:
        (warning,) = started.play("linear", DRIVE).warnings
        assert warning.startswith("The response of force_2 was ")
        assert warning.endswith("its warning level allows -20 to 20 N.")
        assert started.play("linear", 1e-3 * DRIVE).warnings == ()
        model = started.identify("linear", excitation, EstimatorSettings(kind="h1", block_samples=1024))
        assert any("its warning level allows -20 to 20 N." in str(warning) for warning in model.warnings)
        (overdue,) = started.describe("linear").overdue
        assert overdue.startswith(OVERDUE)
        code, stdout, _ = invoke("rigs", "--connect", started.endpoints[0])
        assert code == 0
        assert OVERDUE in stdout
        assert "LC-9" in stdout
        _, stdout, _ = invoke("rigs", "--connect", started.endpoints[0], "--json")
        (told,) = json.loads(stdout[stdout.index("{\n") :])["rigs"]
        assert told["overdue"] == [overdue]
        assert told["responses"][1]["sensor"]["serial_number"] == "LC-9"
        assert "sensor" not in told["responses"][0]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"calibration_date": "1st of May"}, "has the calibration_date '1st of May'; a date is YYYY-MM-DD."),
        ({"warning_level": 5.0, "abort_level": 2.0}, "has the warning level 5 and the abort level 2; they are 0 or in"),
    ],
)
def test_sensors_that_cannot_be_break_the_contract(change, sentence, monkeypatch):
    # A gateway on this library does not serve them; one that is not, may.
    monkeypatch.setattr("duralab_gateway.channels.table.check_sensor", lambda *_, **__: None)
    found = {finding.check: finding for finding in check_contract(equipped(**change))}["description.channels"]
    assert found.outcome is Outcome.FAILED
    assert sentence in found.sentence


SIGNALS = Signals(
    (Channel("a", "kN"), Channel("b", "N"), Channel("t", "degC")),
    10.0,
    np.array([[1.0, 2.0], [500.0, -500.0], [0.0, 0.0]]),
)


def test_calculated_channels_are_in_si_units_whatever_their_terms_are_in():
    made = add_calculated(
        SIGNALS,
        [
            CalculatedChannel(name="sum", kind="force", sum=("a", "b")),
            CalculatedChannel(name="moment", kind="moment", weights={"a": "200 mm", "b": "-0.2 m"}),
        ],
    )
    assert made.names == ("a", "b", "t", "sum", "moment")
    np.testing.assert_allclose(made.samples[3:], [[1500.0, 1500.0], [100.0, 500.0]])
    assert [channel.unit for channel in made.channels[3:]] == ["N", "N*m"]
    assert made.channels[3].calculated == (("a", 1000.0), ("b", 1.0))
    with pytest.raises(InputError, match="cannot be converted"):
        add_calculated(SIGNALS, [CalculatedChannel(name="wrong", kind="force", sum=("a", "t"))])


def test_levels_and_ranges_follow_the_unit_of_the_channel():
    sensor = Sensor(minimum=-2.0, maximum=3.0, warning_level=1.0, abort_level=2.0)
    given = Signals((Channel("a", "kN", sensor=sensor, calculated=(("b", 2.0),)),), 10.0, np.ones((1, 4)))
    (channel,) = convert_units(given).channels
    assert channel.sensor == Sensor(minimum=-2e3, maximum=3e3, warning_level=1e3, abort_level=2e3)
    assert channel.calculated == (("b", 2e3),)
