"""The main job through four real processes: a campaign from its file to its outputs."""

from __future__ import annotations

import html
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
import yaml

import duralab

SERVICES = {"rig_sim", "identifier", "iterator", "recorder"}


@pytest.fixture(scope="module")
def finished(lab, short_document, tmp_path_factory):
    """Two runs of one short campaign in one lab."""
    folder = tmp_path_factory.mktemp("campaigns")
    path = folder / "short.yaml"
    path.write_text(yaml.safe_dump({**short_document, "name": "short"}))
    return [lab.run(path, out=folder / name) for name in ("first", "second")]


def test_four_service_processes_run(lab, finished):
    assert set(lab.process_ids) == SERVICES
    for name, pid in lab.process_ids.items():
        assert name in psutil.Process(pid).cmdline()


def test_every_channel_comes_closer_to_its_target(finished):
    errors = finished[0].iterations.relative_rms_error
    assert errors.shape == (3, 6)
    # Vertical and longitudinal follow at once; lateral has to learn the arc of the wheel's path first.
    assert np.all(errors[-1] < errors[0])
    assert np.all(errors[-1, [0, 2, 3, 5]] < 0.2)


def test_the_recording_holds_what_the_status_says(finished):
    result = finished[0]
    recording = result.recording
    assert recording.whole
    np.testing.assert_array_equal(recording.iterations.relative_rms_error, result.iterations.relative_rms_error)
    target = recording.target.samples
    for number in recording.iterations.numbers:
        error = target - recording.playback(number).response_in_band.samples
        relative = np.sqrt(np.mean(error**2, axis=1) / np.mean(target**2, axis=1))
        np.testing.assert_allclose(relative, recording.iterations.relative_rms_error[number - 1], rtol=1e-8)


def test_the_stream_on_the_bus_is_what_the_rig_answered(finished):
    recording = finished[0].recording
    for number in recording.iterations.numbers:
        playback = recording.playback(number)
        drive, response = recording.signal(playback.run)
        np.testing.assert_array_equal(drive.samples, playback.drive.samples)
        np.testing.assert_array_equal(response.samples, playback.response.samples)


def test_one_seed_gives_the_same_bytes(finished):
    first, second = (result.recording for result in finished)
    for number in first.iterations.numbers:
        one, other = first.playback(number), second.playback(number)
        assert one.drive.samples.tobytes() == other.drive.samples.tobytes()
        assert one.response.samples.tobytes() == other.response.samples.tobytes()


def test_the_target_is_another_vehicle_s_load(lab, finished):
    spec = finished[0].recording.specification
    assert spec.target_rig == "predecessor"
    assert "predecessor" in spec.target_source
    driven = duralab.Signals.from_message(spec.target_drive)
    again = lab.play(spec.target_rig, driven, seed=spec.target_seed).response
    target = duralab.Signals.from_message(spec.target)
    assert again.names == target.names
    assert again.samples.tobytes() == target.samples.tobytes()
    vehicle, rig = lab.describe("predecessor"), lab.describe("front_axle_compliant")
    assert vehicle.content_hash != rig.content_hash


def test_the_report_carries_the_numbers_of_the_recording(finished):
    result = finished[0]
    text = html.unescape(result.report(result.recording_path.with_name("report.html")).read_text())
    assert result.verdict.sentence.split(";")[0] in text
    for value in result.iterations.relative_rms_error[-1]:
        assert f"{value:.3f}" in text
    assert "http://" not in text.split("<script")[0]


def test_the_command_line_does_the_same_and_leaves_no_process(campaign, tmp_path: Path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "duralab", "run", str(campaign(stop__iterations=1)), "--out", str(out)]
    # The services' configurations lie in the temporary folder: their command lines tell whose they are.
    own = {**os.environ, "TMPDIR": str(tmp_path)}
    finished = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=own)
    assert finished.returncode in (0, 3), finished.stderr
    assert "left vertical" in finished.stdout
    assert sorted(path.name for path in out.iterdir()) == ["live.rrd", "logs", "recording.mcap", "report.html"]
    lines = [process.info["cmdline"] or [] for process in psutil.process_iter(["cmdline"])]
    assert [line for line in lines if any(str(tmp_path) in word for word in line)] == []
    again = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    assert again.returncode == 2
    assert "--replace" in again.stderr
