"""`duralab info`: figures of known signals, in every format, and what a recording holds."""

import json

import numpy as np
import pytest
import synthetic_campaign
from test_cli import invoke

from duralab import Channel, Signals
from duralab.analysis import summarize
from duralab.analysis.signal_summary import COLUMNS
from duralab.formats import Format, write_signals

RATE = 1000.0
TIME = np.arange(20_000) / RATE
SUFFIXES = {"rpc3": "rsp", "mdf4": "mf4", "uff58": "uff", "tdms": "tdms", "mat": "mat", "csv": "csv", "parquet": "pq"}


def sine(frequency, amplitude=1.0):
    return amplitude * np.sin(2.0 * np.pi * frequency * TIME)


def signals(**rows):
    return Signals(tuple(Channel(name, "N") for name in rows), RATE, np.stack(list(rows.values())))


def summary(row, *, rate=RATE):
    return summarize(Signals((Channel("a", "N"),), rate, np.atleast_2d(row)))


def test_a_sine_on_a_level_has_its_amplitude_its_rms_and_its_line():
    found = summary(5.0 + sine(10.0, 2.0))
    (channel,) = found.channels
    assert (channel.minimum, channel.maximum, channel.mean) == pytest.approx((3.0, 7.0, 5.0))
    assert channel.rms == pytest.approx(np.sqrt(25.0 + 2.0))
    # A Hann window spreads a line over its two neighbours.
    assert channel.band == pytest.approx((10.0, 10.0), abs=2.5 * found.resolution)
    column = int(channel.psd.argmax())
    assert found.psd_edges[column] - found.resolution <= 10.0 <= found.psd_edges[column + 1] + found.resolution
    assert channel.psd.size == COLUMNS == found.psd_edges.size - 1


def test_the_band_holds_99_percent_of_the_energy():
    both = summary(sine(10.0) + sine(50.0))
    assert both.channels[0].band == pytest.approx((10.0, 50.0), abs=2.5 * both.resolution)
    # 0.4 % of the energy lies above the band, 0.6 % inside it.
    below, above = (summary(sine(10.0) + sine(50.0, np.sqrt(share))) for share in (0.004, 0.006))
    assert below.channels[0].band[1] < 12.0
    assert above.channels[0].band[1] > 48.0


def test_white_noise_has_its_density_in_every_wide_band():
    noise = np.random.default_rng(1).normal(size=400_000)
    found = summary(noise)
    (channel,) = found.channels
    assert channel.band == pytest.approx((0.005 * RATE / 2, 0.995 * RATE / 2), abs=0.002 * RATE)
    # The largest of many lines is larger than their mean, 2/rate, by a small factor.
    assert np.all((channel.psd[-8:] > 2.0 / RATE) & (channel.psd[-8:] < 8.0 / RATE))


@pytest.mark.parametrize("row", [np.ones(1000), np.zeros(1000), np.arange(3.0), np.empty(0)])
def test_what_has_no_spectrum_has_no_band(row):
    (channel,) = summary(row).channels
    assert channel.band is None
    assert channel.psd.size == 0


def test_samples_that_are_not_finite_are_counted():
    row = sine(10.0, 2.0)
    row[[3, 7]] = np.nan, np.inf
    (channel,) = summary(row).channels
    assert channel.not_finite == 2
    assert channel.maximum == pytest.approx(2.0)
    assert channel.band is None


@pytest.mark.parametrize("amplitude", [1e-200, 1e155, 1e200, 1.7e308])
def test_values_whose_square_overflows_have_their_rms_and_no_warning(recwarn, amplitude):
    for row, mean, rms in ((sine(10.0), 0.0, np.sqrt(0.5)), (np.resize([1.0, 0.9], 20_000), 0.95, np.sqrt(0.905))):
        (channel,) = summary(amplitude * row).channels
        assert channel.maximum == pytest.approx(amplitude)
        assert channel.mean / amplitude == pytest.approx(mean, abs=1e-9)
        assert channel.rms / amplitude == pytest.approx(rms)
    assert channel.band is None
    assert list(recwarn) == []


@pytest.mark.parametrize("form", list(Format))
def test_a_file_of_every_format_is_told(tmp_path, form):
    file = tmp_path / f"road.{SUFFIXES[form]}"
    write_signals(signals(speed=sine(10.0, 2.0), load=5.0 + sine(50.0)), file)
    code, stdout, stderr = invoke("info", file, "--json")
    assert code == 0, stderr
    told = json.loads(stdout)
    assert (told["sample_rate"], told["samples"], told["seconds"]) == (1000.0, 20_000, 20.0)
    speed, load = told["channels"]
    assert (speed["name"], speed["unit"]) == ("speed", "N")
    assert (speed["minimum"], speed["maximum"], speed["rms"]) == pytest.approx((-2.0, 2.0, np.sqrt(2.0)), rel=1e-3)
    assert load["mean"] == pytest.approx(5.0, rel=1e-3)
    assert load["band"] == pytest.approx([50.0, 50.0], abs=1.0)
    assert len(load["psd"]) == COLUMNS


def test_the_table_has_a_line_for_each_channel_with_the_shape_of_its_density(tmp_path):
    file = tmp_path / "road.csv"
    write_signals(signals(speed=sine(10.0, 2.0), rest=np.zeros_like(TIME)), file)
    code, stdout, _ = invoke("info", file)
    assert code == 0
    lines = stdout.splitlines()
    assert lines[:2] == [str(file), "2 channels, 20000 samples at 1000 Hz, 20 s"]
    speed, rest = (line.split() for line in lines[3:5])
    assert speed[:5] == ["speed", "N", "-2", "2", "1.414"]
    assert speed[-1].count("█") <= 2
    assert "Hz" in speed
    assert rest == ["rest", "N", "0", "0", "0", "–", "–"]


def test_a_recording_tells_campaign_rig_playbacks_drive_and_response(recording_path):
    made = synthetic_campaign.make()
    code, stdout, stderr = invoke("info", recording_path, "--json")
    assert code == 0, stderr
    told = json.loads(stdout)
    assert (told["campaign"], told["rig"], told["whole"]) == ("demo", "front_axle", True)
    assert told["playbacks"] == list(range(1, len(made.errors) + 1))
    assert set(told["signals"]) == {"target", "drive", "response"}
    drive = told["signals"]["drive"]["channels"]
    assert [channel["name"] for channel in drive] == list(synthetic_campaign.NAMES)
    code, stdout, _ = invoke("info", recording_path)
    assert code == 0
    assert "campaign demo on rig front_axle" in stdout
    assert "Response of the last playback:" in stdout


@pytest.mark.parametrize("name", ["nowhere.csv", "nowhere.mcap", "road.wav"])
def test_what_cannot_be_read_is_one_sentence(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "road.wav").write_bytes(b"RIFF")
    code, _, stderr = invoke("info", name)
    assert code == 2
    assert stderr.startswith("Error: ")
    assert stderr.count("\n") == 1
