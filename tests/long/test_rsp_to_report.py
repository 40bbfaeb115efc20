"""The whole way of a target: `.rsp` in, a campaign on a real lab, `.drv` out, a report of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import duralab
from duralab import Channel, Signals
from duralab.formats import read_signals, write_signals

REAL = Path(__file__).resolve().parents[3] / "shared" / "data" / "pyRPC3_test1.rsp"
NAMES = ("FZ_FL", "FY_FL", "FX_FL", "FZ_FR", "FY_FR", "FX_FR")
RESPONSES = tuple(f"{side}_{axis}" for side in ("left", "right") for axis in ("vertical", "lateral", "longitudinal"))
SIGNS = np.array([[-1.0], [1.0], [1.0], [-1.0], [1.0], [1.0]])
FILE_RATE = 500.0


def duralab_command(*arguments: str | Path) -> None:
    """Run the command as a user does."""
    done = subprocess.run(
        [sys.executable, "-m", "duralab", *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def measured(lab: duralab.Lab, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the wheels of the rig felt, written as another system would have: other names, units, signs and rate."""
    rig = lab.describe("front_axle_compliant")
    time = np.arange(16_000) / rig.sample_rate
    sweep = 0.006 * np.sin(2 * np.pi * (1.0 + 0.5 * time) * time) * np.sin(np.pi * time / 16.0) ** 2
    drive = np.zeros((len(rig.drives), time.size))
    drive[[0, 3]] = sweep, sweep[::-1]
    drive[[1, 4]] = 0.3 * sweep[::-1], 0.3 * sweep
    forces = lab.play("front_axle_compliant", drive).response
    stride = round(forces.sample_rate / FILE_RATE)
    samples = SIGNS * forces.samples[:, ::stride] / 1e3
    signals = Signals(tuple(Channel(name, "kN") for name in NAMES), FILE_RATE, np.ascontiguousarray(samples))
    path = tmp_path_factory.mktemp("road") / "road.rsp"
    write_signals(signals, path)
    return path


def walk(lab: duralab.Lab, campaign: Path, folder: Path) -> tuple[duralab.CampaignResult, Path, str]:
    """Run a campaign, export its last drive, report it; return result, drive file and report."""
    result = lab.run(campaign, out=folder)
    drive, report = folder / "last.drv", folder / "campaign.html"
    duralab_command("export", result.recording_path, drive)
    duralab_command("report", result.recording_path, "--out", report)
    return result, drive, report.read_text(encoding="utf-8")


def test_a_file_of_another_system_becomes_a_drive_file_and_a_report(
    lab: duralab.Lab, measured: Path, campaign: Any, tmp_path: Path
) -> None:
    channels = {
        response: {"from": name, "scale": float(sign)}
        for response, name, sign in zip(RESPONSES, NAMES, SIGNS[:, 0], strict=True)
    }
    target = {
        "file": str(measured),
        "channels": channels,
        "edit": [
            {"cut": {"from": 2.0, "to": 14.0}},
            "remove_mean",
            {"resample": {"rate": 1000}},
            {"taper": {"seconds": 0.5}},
        ],
    }
    result, file, report = walk(lab, campaign(target=target), tmp_path / "out")
    errors = result.iterations.relative_rms_error
    assert np.all(errors[-1] < errors[0])
    # Vertical and lateral were driven when it was measured; what is longitudinal is small and mostly crosstalk.
    assert np.all(errors[-1, [0, 3]] < 0.2)

    played = result.recording.playback(result.iterations.numbers[-1])
    exported = read_signals(file)
    assert exported.names == played.drive.names
    assert exported.sample_rate == played.drive.sample_rate
    assert [channel.unit for channel in exported.channels] == [channel.unit for channel in played.drive.channels]
    steps = np.abs(played.drive.samples).max(axis=1, keepdims=True) / 32752
    assert np.all(np.abs(exported.samples - played.drive.samples) <= 0.51 * steps)
    # Another lab plays the file: with the same noise it gets the same response, but for the file's quantisation.
    own, others = (
        lab.play("front_axle_compliant", drive, seed=7).response.samples for drive in (played.drive, exported)
    )
    assert np.all(np.std(others - own, axis=1) < 1e-2 * np.std(own, axis=1))

    for step in ("cut", "remove mean", "resample", "taper"):
        assert f"&nbsp; {step}</th>" in report
    assert "500 Hz became 1000 Hz" in report
    assert result.recording.sha256 in report
    for channel in RESPONSES:
        assert channel.replace("_", " ") in report


@pytest.mark.skipif(not REAL.exists(), reason="pyRPC3_test1.rsp lies beside the project, not in it; it is not here")
def test_a_file_that_another_program_wrote_goes_the_same_way(lab: duralab.Lab, campaign: Any, tmp_path: Path) -> None:
    # No wheel measured this file: its first channel, the only one that moves fast, is taken for the forces of all.
    scales = {"left_vertical": 4.0, "left_lateral": 1.0, "left_longitudinal": 1.0}
    scales |= {name.replace("left", "right"): -scale for name, scale in scales.items()}
    target = {
        "file": str(REAL),
        "channels": {name: {"from": "FDO_54xLoc_sh", "scale": scale} for name, scale in scales.items()},
        "edit": [
            "remove_drift",
            "remove_mean",
            {"resample": {"rate": 1000}},
            {"filter": {"band_pass": [1.0, 30.0]}},
            {"taper": {"seconds": 0.5}},
        ],
    }
    # The commands were taken in the test before; here the same from a script, which is quicker.
    result = lab.run(campaign(target=target), out=tmp_path / "out")
    drive = tmp_path / "last.drv"
    write_signals(result.recording.playback(result.iterations.numbers[-1]).drive, drive)
    report = result.report().read_text(encoding="utf-8")
    errors = result.iterations.relative_rms_error
    assert result.recording.target.sample_rate == 1000.0
    assert result.recording.target.duration == pytest.approx(8.192, abs=1e-3)
    assert result.iterations.overall[-1] < 0.6 * result.iterations.overall[0], errors
    assert read_signals(drive).samples.shape == (6, 8192)
    assert "250 Hz became 1000 Hz" in report
