"""The report's figures of load cycles and of drives at their limits, against signals whose answer is known."""

import base64
import json
import re

import numpy as np
import pytest
import synthetic_campaign

from duralab.data import (
    ActuatorUse,
    Channel,
    ChannelRecord,
    Distortion,
    Model,
    Playback,
    Signals,
    SourceRecord,
    StepRecord,
    step_record,
)
from duralab.recording import open_recording
from duralab.report import load_figures, model_figures, write_report
from duralab.report.actuator_rows import actuator_rows, held_rows
from duralab.report.held_drives import Limit, held_stretches, largest_speed
from duralab.report.waveforms import Shown, held_bands
from duralab_proto.arrays import to_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2

RATE = 1000.0
FORCE = (Channel("force", "N"),)


def values(encoded):
    return np.frombuffer(base64.b64decode(encoded["bdata"]), dtype="<f4").astype(float)


def playback(number, samples):
    signals = Signals(FORCE, RATE, samples)
    return Playback(number, f"r{number}", signals, signals, signals, ())


def sines(scale):
    """Ten periods of ±2 about 1, and one of ±6 about 0, a whole number of samples each."""
    phase = 2 * np.pi * np.arange(100) / 100
    small, large = 1.0 + 2.0 * np.sin(phase), 6.0 * np.sin(phase)
    return scale * np.concatenate([np.tile(small, 5), large, np.tile(small, 5)])[np.newaxis]


@pytest.fixture
def counted():
    shown = Shown(
        target=Signals(FORCE, RATE, sines(1.0)),
        first=playback(1, sines(0.5)),
        best=playback(2, sines(1.0)),
        last=playback(3, sines(0.9)),
        band=(1.0, 20.0),
        block_samples=256,
    )
    return load_figures.counted_loads(shown, 0)


def test_target_first_and_best_playback_are_counted(counted):
    assert [load.name for load in counted] == ["target", "playback 1", "playback 2 (best)"]


def test_range_pairs_of_known_cycles(counted):
    target, first, best = load_figures.range_pairs(counted, "N")["data"]
    cycles, ranges = values(target["x"]), values(target["y"])
    assert ranges[-1] == pytest.approx(12.0, abs=1e-6)
    # The one large cycle and ten small ones of 4; the halves at the ends of the signal make up for each other.
    assert cycles[np.searchsorted(ranges, 6.0)] == pytest.approx(1.0, abs=0.51)
    assert cycles[np.searchsorted(ranges, 3.8)] == pytest.approx(11.0, abs=1.01)
    assert np.all(np.diff(cycles) <= 0)
    np.testing.assert_array_equal(values(best["x"]), cycles)
    assert values(first["y"]).max() == pytest.approx(6.0, abs=1e-6)


def test_level_crossings_and_time_at_level_of_known_cycles(counted):
    crossings = load_figures.level_crossings(counted, "N")["data"][0]
    levels = values(crossings["y"])
    assert values(crossings["x"])[np.searchsorted(levels, 4.0)] == 1
    assert values(crossings["x"])[np.searchsorted(levels, 2.0)] == 11
    times = load_figures.time_at_level(counted, "N")["data"]
    for trace in times:
        assert values(trace["x"]).sum() == pytest.approx(100.0, rel=1e-6)


def test_range_mean_puts_each_cycle_in_its_class_and_shares_the_classes(counted):
    wanted, done = (load_figures.range_mean(counted, place, "N")["data"][0] for place in (0, -1))
    assert wanted["x"] == done["x"]
    assert wanted["zmax"] == done["zmax"]
    counts = 10 ** values(wanted["z"]).reshape([int(n) for n in wanted["z"]["shape"].split(",")])
    ranges, means = values(wanted["y"]), values(wanted["x"])
    assert np.nansum(counts) == pytest.approx(counted[0].cycles.counts.sum(), rel=1e-5)
    row, column = np.unravel_index(np.nanargmax(counts), counts.shape)
    assert ranges[row] == pytest.approx(4.0, abs=ranges[1] - ranges[0])
    assert means[column] == pytest.approx(1.0, abs=means[1] - means[0])


def test_a_signal_at_rest_is_drawn_too():
    still = Signals(FORCE, RATE, np.zeros((1, 300)))
    shown = Shown(
        still, playback(1, still.samples), playback(1, still.samples), playback(1, still.samples), (1, 20), 64
    )
    counted = load_figures.counted_loads(shown, 0)
    for draw in (load_figures.range_pairs, load_figures.level_crossings, load_figures.time_at_level):
        json.dumps(draw(counted, "N"), allow_nan=False)
    json.dumps(load_figures.range_mean(counted, 0, "N"), allow_nan=False)


def test_stretches_at_a_limit_are_found_with_what_holds_them():
    limited = Channel("a", "m", minimum=-0.1, maximum=0.1, slew_limit=2.0)
    time = np.arange(2000) / RATE
    # Near its travel twice, 40 ms apart, and at its speed for 20 ms; a channel without limits beside it.
    corners = [0.0, 0.2, 0.5, 0.6, 0.601, 0.64, 0.641, 0.66, 0.661, 1.0, 1.5, 1.52, 2.0]
    drive = [0.0, 0.0, 0.0996, 0.0996, 0.0985, 0.0985, 0.0999, 0.0999, 0.0985, 0.0, 0.0, 0.04, 0.04]
    samples = np.interp(time, corners, drive)
    signals = Signals((limited, Channel("b", "m")), RATE, np.stack([samples, 10.0 * samples]))
    travel, speed = held_stretches(signals)
    assert (travel.drive, travel.limit) == ("a", Limit.TRAVEL)
    assert (travel.start, travel.end) == (pytest.approx(0.5, abs=3e-3), pytest.approx(0.661, abs=3e-3))
    assert travel.held_seconds == pytest.approx(0.12, abs=5e-3)
    assert (speed.drive, speed.limit) == ("a", Limit.SPEED)
    assert (speed.start, speed.end) == (pytest.approx(1.5), pytest.approx(1.52))
    assert largest_speed(samples[1400:], RATE) == pytest.approx(2.0)
    rows = held_rows([travel, speed], signals.channels)
    assert [row.limit for row in rows] == ["travel, ± 100 mm", "speed, 2 m/s"]
    assert rows[1].when == "1.50 to 1.52 s"
    assert len(held_bands([travel, speed])) == 2
    assert held_bands([travel, speed], drive="b") == []


def test_a_drive_within_its_limits_is_held_nowhere():
    channel = Channel("a", "m", minimum=-0.1, maximum=0.1, slew_limit=2.0)
    time = np.arange(2000) / RATE
    assert held_stretches(Signals((channel,), RATE, 0.09 * np.sin(2 * np.pi * time)[np.newaxis])) == []


def test_the_use_of_an_actuator_is_told_over_its_limits():
    channel = Channel("a", "m", minimum=-0.1, maximum=0.1, slew_limit=2.0)
    ramp = Signals((channel,), RATE, np.linspace(0.0, 0.05, 51)[np.newaxis])
    use = ActuatorUse("a", 0.5, 0.01, 0.002, 0.75, 2.8e7)
    (row,) = actuator_rows([use, ActuatorUse("unknown", 0.1, 0.0, 0.0)], ramp)
    assert row.peak_percent == 50.0
    assert row.speed_percent == pytest.approx(50.0)
    assert (row.saturated, row.load_pressure, row.supply_pressure) == ("1.00 %", "75 %", "280 bar")
    unlimited = Signals((Channel("a", "m"),), RATE, ramp.samples)
    assert actuator_rows([use], unlimited)[0].speed_percent is None


@pytest.fixture
def distorted(campaign, tmp_path):
    """Write the synthetic campaign with a model that tells nonlinearity and noise apart, and an edited target."""
    messages = synthetic_campaign.steps(campaign)
    model = next(message for message in messages if isinstance(message, identifier_pb2.Model))
    response = np.frombuffer(model.response_psd.data).reshape(-1, 6)
    model.distortion.CopyFrom(
        identifier_pb2.Distortion(
            noise_psd=to_array(1e-4 * response),
            distortion_psd=to_array(1e-2 * response),
            distortion_share=to_array(np.full(6, 0.1)),
            noise_share=to_array(np.full(6, 0.01)),
        )
    )
    before = Signals(FORCE, 500.0, np.ones((1, 1000)))
    after = Signals(FORCE, 1000.0, np.ones((1, 1500)))
    step = step_record(
        name="shorten_by_damage",
        settings="{keep: 0.95}",
        before=before,
        after=after,
        spikes={},
        damage_kept={"force": 0.97},
        sections=[(0, 1)],
    )
    messages[0].target_steps.append(step.to_message())
    for message in messages:
        if isinstance(message, iterator_pb2.IterationStep) and message.iteration == 4:
            message.remarks.append("Playback 4: the target of left_lateral is out of the rig's reach.")
    path = synthetic_campaign.write(tmp_path / "r.mcap", messages)
    return path, Model.from_message(model)


def test_nonlinearity_is_drawn_below_the_response_and_told_in_percent(distorted, tmp_path):
    path, model = distorted
    assert isinstance(model.distortion, Distortion)
    assert model.distortion.even_distortion_psd.shape == (0, 6)
    traces = model_figures.nonlinearity(model, model.distortion, 0, band=synthetic_campaign.BAND)["data"]
    assert [trace["name"] for trace in traces] == ["response", "nonlinear", "noise"]
    shared = np.intersect1d(values(traces[0]["x"]), values(traces[1]["x"]))
    assert shared.size > 50
    at = [dict(zip(values(trace["x"]), values(trace["y"]), strict=True)) for trace in traces[:2]]
    assert at[1][shared[9]] / at[0][shared[9]] == pytest.approx(1e-2, rel=1e-5)
    html = write_report(path, tmp_path / "r.html").read_text(encoding="utf-8")
    section = html[html.index('id="model"') : html.index('id="actuators"')]
    assert section.count("<td>10 %</td><td>1 %</td>") == 6


def test_how_the_file_was_read_stands_in_the_page_and_in_print_as_step_0(campaign, tmp_path):
    messages = synthetic_campaign.steps(campaign)
    read = SourceRecord(
        "FZ_FL", "N", "kN", -1000.0, peak_before=4.25, rms_before=0.5, peak_after=4250.0, rms_after=500.0
    )
    channels = (
        ChannelRecord("left_vertical", 0.0, source=read),
        ChannelRecord("left_lateral", 0.0, source=SourceRecord("")),
    )
    step = StepRecord("read_file", "{file: road.csv}", 100, 100, 1000.0, 1000.0, channels)
    messages[0].target_steps.append(step.to_message())
    path = synthetic_campaign.write(tmp_path / "r.mcap", messages)
    html = write_report(path, tmp_path / "r.html").read_text(encoding="utf-8")
    assert re.search(r"<tr><th scope=\"row\">0&nbsp; read file</th>", html)
    rows = re.search(r"aria-label=\"Channels read from the file\".*?</table>", html, re.DOTALL)[0]
    found = [
        re.findall(r"<t[hd][^>]*>([^<]*)</t[hd]>", row) for row in re.findall(r"<tr>.*?</tr>", rows, re.DOTALL)[1:]
    ]
    assert found == [
        ["left vertical", "FZ_FL", "N", "kN", "1000", "turned", "4.25 kN", "4250 N", "0.5 kN", "500 N"],
        ["left lateral", "none, silent", *8 * ["–"]],
    ]
    told = str(open_recording(path)).splitlines()[1]
    assert told.startswith("target, step 0, read_file: left_vertical: FZ_FL in kN (stated, the file says N) × -1000 ")


def test_the_steps_of_the_target_and_what_was_out_of_reach_stand_in_the_page(distorted, tmp_path):
    html = write_report(distorted[0], tmp_path / "r.html").read_text(encoding="utf-8")
    row = re.search(r"<tr><th scope=\"row\">1&nbsp; shorten by damage.*?</tr>", html, re.DOTALL)[0]
    for wanted in ("2 s, 500 Hz", "1.5 s, 1000 Hz", "{keep: 0.95}", "damage kept: force 97.0 %"):
        assert wanted in row
    section = html[html.index('id="actuators"') : html.index('id="repeat"')]
    assert "out of the rig&#39;s reach" in section
