"""What users get wrong: one sentence with the value and what is allowed, a non-zero exit, nothing half-written."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from duralab.cli.application import app

RESPONSES = [
    "left_vertical",
    "left_lateral",
    "left_longitudinal",
    "right_vertical",
    "right_lateral",
    "right_longitudinal",
]


def run(lab, campaign: Path, out: Path) -> tuple[int, str]:
    # In this process: starting one for each case would take longer than all that is judged here.
    command = ["run", str(campaign), "--out", str(out), "--connect", lab.endpoints[0]]
    finished = CliRunner().invoke(app, command)
    assert isinstance(finished.exception, SystemExit)
    assert not [path for path in out.rglob("*") if path.is_file()]
    return finished.exit_code, finished.stderr


def write_target(path: Path, samples: np.ndarray, *, names: list[str] = RESPONSES, rate: float = 1000.0) -> Path:
    header = ",".join(["time [s]", *(f"{name} [N]" for name in names)])
    time = np.arange(samples.shape[1]) / rate
    np.savetxt(path, np.vstack([time, samples]).T, delimiter=",", header=header, comments="")
    return path


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rig": "front_axel"}, ["front_axel", "front_axle"]),
        ({"control_band__highest_frequency": 700.0}, ["700", "46"]),
        ({"excitation__highest_frequency": 600.0, "control_band__highest_frequency": 550.0}, ["600", "500"]),
        ({"control_band__lowest_frequency": 0.1}, ["0.1", "0.25"]),
        ({"excitation__rms": 0.2}, ["left_vertical", "0.115"]),
        ({"excitation__rms": float("nan")}, ["rms", "nan"]),
        ({"excitation__rms": 0.02}, ["left_lateral", "2 m/s", "fits"]),
        ({"excitation__duration": 12.0}, ["12", "realisations"]),
        ({"excitation__duration": 3.0}, ["2048", "lasts only 1 s"]),
        ({"update__iteration_gain": 1.5}, ["gain", "1.5"]),
        ({"update__gian": 0.5}, ["gian", "gain"]),
        ({"update__kind": "magic"}, ["magic", "basic_twr", "adaptive_modelling"]),
        ({"stop__iterations": 0}, ["iterations", "0"]),
        ({"target__vehicle": "front_axle"}, ["front_axle", "left_height"]),
        ({"name": "../../etc"}, ["../../etc"]),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_a_wrong_value_is_named(lab, campaign, tmp_path: Path, changes, said):
    code, errors = run(lab, campaign(**changes), tmp_path / "out")
    assert code == 2, errors
    assert errors.strip().count("\n") == 0
    for text in said:
        assert text in errors


def _random(channels: int = 6, samples: int = 8000) -> np.ndarray:
    return np.random.default_rng(0).standard_normal((channels, samples)) * 100.0


def _with_nan() -> np.ndarray:
    samples = _random()
    samples[2, 4000] = np.nan
    return samples


@pytest.mark.parametrize(
    ("samples", "options", "said"),
    [
        (_with_nan(), {}, ["left_longitudinal", "nan"]),
        (_random(5), {"names": RESPONSES[:5]}, ["right_longitudinal"]),
        (_random(), {"rate": 500.0}, ["500", "1000"]),
        (_random(6, 0), {}, ["no samples", "empty", "0"]),
    ],
    ids=["NaN", "missing channel", "sample rate", "empty"],
)
def test_a_wrong_target_file_is_named(lab, campaign, tmp_path: Path, samples, options, said):
    write_target(tmp_path / "target.csv", samples, **options)
    code, errors = run(lab, campaign(target={"file": "target.csv"}), tmp_path / "out")
    assert code == 2, errors
    assert errors.strip().count("\n") == 0
    assert any(text in errors for text in said) if "empty" in said else all(text in errors for text in said), errors


def test_a_lab_that_is_not_there_is_named(campaign, tmp_path: Path):
    command = [sys.executable, "-m", "duralab", "run", str(campaign()), "--out", str(tmp_path / "out")]
    finished = subprocess.run(
        [*command, "--connect", "tcp/127.0.0.1:9"], capture_output=True, text=True, timeout=180, check=False
    )
    assert finished.returncode == 2
    assert "tcp/127.0.0.1:9" in finished.stderr


def test_a_port_in_use_is_named(lab):
    endpoint = lab.endpoints[0]
    command = [sys.executable, "-m", "duralab", "up", "--listen", endpoint]
    finished = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    assert finished.returncode == 2
    assert endpoint in finished.stderr
    assert finished.stderr.strip().count("\n") == 0
