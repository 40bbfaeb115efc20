"""Levels and calculated channels on a real bus: warned, latched, published and known by their FRF."""

import subprocess
import sys

import numpy as np
import pytest
from rigs import Springs, client_of, hump

from duralab_bus import ConfigError
from duralab_gateway import ChannelTable
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import array_pb2, rig_pb2
from duralab_settings import parse_yaml


def tables(text, rig="springs"):
    return {rig: ChannelTable.model_validate(parse_yaml(text))}


CALCULATED = """
calculated:
  - {name: both, kind: force, sum: [a_force, b_force]}
  - {name: roll, kind: moment, weights: {a_force: 0.5 m, b_force: -0.25 m}}
"""


@pytest.mark.parametrize("block_samples", [7, 30])
def test_calculated_responses_are_answered_and_published(block_samples):
    drive = hump(100)
    drive[1] *= 0.3
    with client_of(Springs(block_samples=block_samples), channels=tables(CALCULATED)) as client:
        response = client.play("a", drive)
        a, b = 1.0e4 * drive
        np.testing.assert_array_equal(response[:2], [a, b])
        np.testing.assert_array_equal(response[2], a + b)
        np.testing.assert_allclose(response[3], 0.5 * a - 0.25 * b, rtol=1e-12)
        np.testing.assert_array_equal(client.published("a")[1], response)


class KnownSprings(Springs):
    def sampled_frf(self, frequency):
        return np.tile(1.0e4 * np.eye(2, dtype=complex), (len(frequency), 1, 1))


def test_the_frf_of_calculated_responses_follows_from_the_measured_ones():
    with client_of(KnownSprings(), channels=tables(CALCULATED)) as client:
        request = rig_pb2.RigFrfRequest(frequency=to_array(np.array([1.0, 2.0])))
        frf = from_array(client.ask(client.bus.keys.rig_frf, request, rig_pb2.RigFrf).frf)
    np.testing.assert_allclose(frf[1], [[1e4, 0], [0, 1e4], [1e4, 1e4], [5e3, -2.5e3]])


LEVELS = "sensors: {a_force: {warning_level: 300}, b_force: {warning_level: 100, abort_level: 450}}"


def warnings_of(client, run, drive):
    result = client.ask(client.bus.keys.rig_play, client.request(run, drive), rig_pb2.PlayResult)
    return list(result.warnings)


def test_a_crossed_warning_level_is_reported_once_a_run_and_ends_nothing():
    rig = Springs(block_samples=10)
    with client_of(rig, channels=tables(LEVELS)) as client:
        assert warnings_of(client, "quiet", hump(size=0.009)) == []
        first, second = warnings_of(client, "loud", hump(size=0.04))
        assert first.startswith("The response of b_force was 1")
        assert first.endswith("its warning level allows -100 to 100 N.")
        assert second.startswith("The response of a_force was 3")
        assert len(warnings_of(client, "again", hump(size=-0.02))) == 1
        assert client.state().mode == rig_pb2.RIG_MODE_IDLE
        assert rig.stops == []


def test_an_abort_level_ends_the_run_and_latches_until_a_reset():
    rig = Springs(block_samples=10)
    with client_of(rig, channels=tables(LEVELS)) as client:
        fault = client.fault("a", hump(size=0.05))
        assert "the response of b_force was 4" in str(fault)
        assert "its abort level allows -450 to 450 N" in str(fault)
        state = client.state()
        assert state.mode == rig_pb2.RIG_MODE_INTERLOCKED
        assert "abort level" in state.reason
        assert "is interlocked" in str(client.fault("b", hump(size=0.001)))
        assert client.reset().mode == rig_pb2.RIG_MODE_IDLE
        client.play("c", hump(size=0.001))
        assert len(rig.stops) == 1


def test_the_level_of_a_calculated_response_is_watched_too():
    text = "calculated: [{name: both, kind: force, sum: [a_force, b_force], abort_level: 450}]"
    with client_of(Springs(block_samples=10), channels=tables(text)) as client:
        assert "the response of both was 4" in str(client.fault("a", hump(size=0.04)))


def test_sensors_that_a_rig_describes_itself_are_watched_and_checked():
    sensor = array_pb2.Sensor(serial_number="7", abort_level=100.0)
    channels = [array_pb2.Channel(name="c_force", unit="N", minimum=-1e4, maximum=1e4, sensor=sensor)]

    class Three(Springs):
        def play(self, commands, run):
            return np.vstack([super().play(commands, run), 1.0e4 * commands[:1]])

    with client_of(Three(responses=channels)) as client:
        assert "abort level allows -100 to 100 N" in str(client.fault("a", hump(size=0.04)))
    channels[0].sensor.calibration_due = "next year"
    sentence = "channels.springs: c_force: calibration_due is 'next year'"
    with pytest.raises(ConfigError, match=sentence), client_of(Three(responses=channels)):
        pass


def test_a_table_of_another_rig_or_response_is_refused():
    for channels, sentence in (
        (tables("{}", rig="spring"), "channels: spring is not a rig served here; those are springs."),
        (tables("sensors: {c_force: {}}"), "channels.springs: there is no response c_force"),
    ):
        with pytest.raises(ConfigError, match=sentence), client_of(Springs(), channels=channels):
            pass


def test_pint_is_imported_only_where_a_unit_is_converted():
    code = "import sys, duralab_gateway.gateway_process; sys.exit('pint' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
