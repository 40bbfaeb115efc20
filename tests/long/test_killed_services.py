"""A service that dies in a campaign: one clear sentence, no hang, nothing half-written, no process left."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

import duralab


@pytest.mark.parametrize("service", ["rig_sim", "identifier", "iterator", "recorder"])
def test_a_killed_service_ends_the_run_with_its_name(service: str, campaign, tmp_path: Path):
    # Long enough that the kill falls into the campaign, wherever this machine is busy.
    path = campaign(target__road={"iso_class": "C", "seed": 1, "duration": 120.0}, stop__iterations=9)
    out = tmp_path / "out"
    running = subprocess.Popen(
        [sys.executable, "-m", "duralab", "run", str(path), "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert running.stdout is not None
    # The identifier works at the beginning only; the others are killed between playbacks.
    awaited = "identifying" if service == "identifier" else "playing iteration 2"
    for line in running.stdout:
        if awaited in line:
            break
    children = psutil.Process(running.pid).children(recursive=True)
    victim = next(child for child in children if service in child.cmdline())
    victim.send_signal(signal.SIGKILL)
    killed = time.monotonic()
    _, errors = running.communicate(timeout=120)
    assert time.monotonic() - killed < 30.0
    assert running.returncode == 1
    assert errors.count("\n") == 1
    assert service in errors
    assert "Traceback" not in errors
    # Without an iterator nobody closes the recording, without a recorder nobody sends it: it stays where it lies.
    where_written = service in ("iterator", "recorder")
    left = ["logs", "recordings"] if where_written else ["live.rrd", "logs", "recording.mcap"]
    assert sorted(path.name for path in out.iterdir()) == left
    kept = out / ("recordings/front_axle_demo.mcap" if where_written else "recording.mcap")
    assert f"What was played until then is in {kept};" in errors
    recording = duralab.open(kept)
    assert recording.specification.id == "front_axle_demo"
    if service != "identifier":
        assert recording.model is not None
        assert list(recording.iterations.numbers)[:1] == [1]
        drive, response = recording.signal("front_axle_demo.i01")
        np.testing.assert_array_equal(drive.samples, recording.playback(1).drive.samples)
        np.testing.assert_array_equal(response.samples, recording.playback(1).response.samples)
        assert duralab.write_report(recording, tmp_path / "report.html").exists()
    _, alive = psutil.wait_procs(children, timeout=30.0)
    assert alive == []


def test_killing_the_run_itself_leaves_no_orphan(campaign, tmp_path: Path):
    running = subprocess.Popen(
        [sys.executable, "-m", "duralab", "run", str(campaign()), "--out", str(tmp_path / "out")],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert running.stdout is not None
    for line in running.stdout:
        if "identifying" in line:
            break
    children = psutil.Process(running.pid).children(recursive=True)
    # Four services, and the process that forked them.
    assert len(children) == 5
    running.kill()
    running.communicate(timeout=120)
    _, alive = psutil.wait_procs(children, timeout=30.0)
    assert alive == []
