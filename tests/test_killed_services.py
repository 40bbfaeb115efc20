"""A service that dies in a campaign: one clear sentence, no hang, nothing half-written, no process left."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest


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
    assert [path.name for path in out.iterdir()] == ["logs"]
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
    assert len(children) == 4
    running.kill()
    running.communicate(timeout=120)
    _, alive = psutil.wait_procs(children, timeout=30.0)
    assert alive == []
