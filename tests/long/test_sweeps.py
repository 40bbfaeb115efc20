"""Sweeps on real workers: broken off and taken up again, a failing point among others, the same bytes in every cell."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import dask
import numpy as np
import psutil
import pytest
import yaml

import duralab
from duralab.data import Channel, Signals
from duralab.formats import write_signals
from duralab.sweeps import read_results
from duralab.sweeps.cluster import open_workers

from ..multihost.host_network import HostNetwork, why_not

# Half a minute of processor time in all, most of it the start of processes, which a busy machine makes long.
pytestmark = pytest.mark.timeout(600)
SECONDS = 250.0
RESPONSES = ("left_wing", "right_wing", "nose", "tail", "left_wing_front", "fin")
CAMPAIGN = {
    "name": "aircraft",
    # In closed form: the rig is there at once.
    "rig": "aerospace",
    "seed": 7,
    "target": {"file": "target.parquet"},
    "excitation": {
        "lowest_frequency": 4.0,
        "highest_frequency": 60.0,
        "corner_frequency": 10.0,
        "decibels_per_octave": 0.0,
        "rms": 1.0,
        "duration": 20.0,
        "fade": 0.2,
    },
    "estimator": {"block_samples": 512},
    "control_band": {"lowest_frequency": 6.0, "highest_frequency": 50.0},
    "update": {"kind": "basic_twr", "iteration_gain": 0.8},
    # A target of noise that this structure cannot follow; without these bounds its first drive would not be played.
    "stop": {"iterations": 1, "error_bound": None, "peak_bound": None, "damage_bound": None},
}
SWEEP = {
    "name": "tiny",
    "campaign": "aircraft.yaml",
    # More than the shakers have: the third point fails when it meets its rig.
    "axes": {"excitation.rms": [0.5, 1.0, 100.0]},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("sweeps")
    samples = np.random.default_rng(3).normal(size=(len(RESPONSES), 6 * 512))
    samples *= np.hanning(samples.shape[1])
    channels = tuple(Channel(name, "m/s^2") for name in RESPONSES)
    write_signals(Signals(channels, 512.0, samples), made / "target.parquet")
    (made / "aircraft.yaml").write_text(yaml.safe_dump(CAMPAIGN))
    for cell in ("process", "lab"):
        axes = SWEEP["axes"] if cell == "process" else {"excitation.rms": [1.0]}
        (made / f"{cell}.yaml").write_text(yaml.safe_dump({**SWEEP, "axes": axes, "cell": cell}))
    return made


def command(folder, cell):
    return [
        sys.executable,
        "-m",
        "duralab",
        "sweep",
        str(folder / f"{cell}.yaml"),
        "--out",
        str(folder / cell),
        "--workers",
        "1",
    ]


def outcomes(folder):
    return {path.parent.name: path.stat().st_mtime_ns for path in folder.glob("points/*/outcome.parquet")}


@pytest.fixture(scope="module")
def resumed(folder):
    """A sweep that was killed after its first point, and the run that went on with it."""
    killed = subprocess.Popen(command(folder, "process"), stdout=subprocess.DEVNULL, start_new_session=True)
    deadline = time.monotonic() + SECONDS
    while not outcomes(folder / "process") and killed.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    family = [psutil.Process(killed.pid), *psutil.Process(killed.pid).children(recursive=True)]
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait()
    _, alive = psutil.wait_procs(family, timeout=30.0)
    before = outcomes(folder / "process")
    ran = subprocess.run(command(folder, "process"), capture_output=True, text=True, timeout=SECONDS, check=False)
    return alive, before, ran


def test_a_killed_sweep_leaves_no_process_and_goes_on_where_it_was(folder, resumed):
    alive, before, ran = resumed
    assert alive == []
    assert before
    after = outcomes(folder / "process")
    assert len(after) == 3, ran.stderr
    assert {id: after[id] for id in before} == before


def test_a_point_that_fails_is_recorded_with_its_sentence_and_stops_no_other(folder, resumed):
    _, _, ran = resumed
    assert ran.returncode == 1, ran.stderr
    assert "1 of 3 campaigns failed" in " ".join(ran.stderr.split())
    results = read_results(folder / "process")
    (failed,) = results.failed
    assert failed["excitation.rms"] == 100.0
    assert "leaves room for" in failed["sentence"]
    assert sorted(row["excitation.rms"] for row in results.finished) == [0.5, 1.0]
    assert (folder / "process" / "report.html").is_file()


def test_nothing_is_run_and_nobody_started_where_all_has_ended(folder, resumed):
    before = outcomes(folder / "process")
    logs = sorted((folder / "process" / "logs").iterdir())
    again = subprocess.run(command(folder, "process"), capture_output=True, text=True, timeout=SECONDS, check=False)
    assert again.returncode == 1
    assert outcomes(folder / "process") == before
    assert sorted((folder / "process" / "logs").iterdir()) == logs


@contextmanager
def running_scheduler(folder, *, network=None, workers=("worker",)):
    """Give the address of a Dask scheduler that runs already with its workers, as in a cluster."""
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    usual = ["--no-dashboard", "--scheduler-file", str(file)]

    def start(host, *words):
        address = network.address(host) if network else "127.0.0.1"
        command = [sys.executable, "-m", "dask", *words, *usual, "--host", address]
        where = network.on(host, command) if network else command
        return subprocess.Popen(where, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    started = [start("router", "scheduler", "--port", "0")]
    started += [start(host, "worker", "--nthreads", "1") for host in workers]
    try:
        deadline = time.monotonic() + SECONDS
        while not file.is_file() and time.monotonic() < deadline:
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"]
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait(30.0)


def test_a_lab_of_processes_on_a_worker_of_a_cluster_gives_the_same_bytes(folder, resumed):
    with running_scheduler(folder) as address:
        words = [*command(folder, "lab")[:-2], "--scheduler", address]
        ran = subprocess.run(words, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert ran.returncode == 0, ran.stderr
    (row,) = read_results(folder / "lab").finished
    one, other = (duralab.open(folder / cell / "points" / row["id"] / "recording.mcap") for cell in ("process", "lab"))
    for what in ("drive", "response"):
        first, second = (getattr(recording.playback(1), what).samples for recording in (one, other))
        assert first.tobytes() == second.tobytes(), what
    pairs = zip(one.signal(one.runs[0]), other.signal(other.runs[0]), strict=True)
    assert all(first.samples.tobytes() == second.samples.tobytes() for first, second in pairs)


@pytest.mark.skipif(bool(why_not()), reason=why_not() or "possible")
def test_workers_on_other_hosts_give_the_same_bytes(folder, resumed):
    (folder / "hosts.yaml").write_text(
        yaml.safe_dump({**SWEEP, "axes": {"excitation.rms": [0.5, 1.0]}, "cell": "process"})
    )
    with (
        HostNetwork(f"duralabsweep{os.getpid()}") as network,
        running_scheduler(folder, network=network, workers=("rig", "control")) as address,
    ):
        assert address.startswith(f"tcp://{network.address('router')}:")
        # Both workers first: one that comes late would leave both campaigns to the other.
        wait = f"from distributed import Client; Client({address!r}).wait_for_workers(2, timeout={SECONDS})"
        subprocess.run(network.on("viewer", [sys.executable, "-c", wait]), timeout=SECONDS, check=True)
        words = network.on("viewer", [*command(folder, "hosts")[:-2], "--scheduler", address])
        ran = subprocess.run(words, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert ran.returncode == 0, ran.stderr
    rows = read_results(folder / "hosts").finished
    assert len({row["worker"] for row in rows}) == len(rows) == 2
    for row in rows:
        one, other = (folder / out / "points" / row["id"] / "recording.mcap" for out in ("process", "hosts"))
        first, second = (duralab.open(path).playback(1).response.samples for path in (one, other))
        assert first.tobytes() == second.tobytes()


def test_a_scheduler_that_is_none_is_told(folder):
    words = [*command(folder, "lab")[:-2], "--out", str(folder / "none"), "--scheduler", "http://head"]
    ran = subprocess.run(words, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert ran.returncode == 2
    assert "tcp://head:8786" in " ".join(ran.stderr.split())
    assert not Path(folder / "none" / "points").exists()


def test_as_many_workers_as_cores_keep_to_a_core_each(tmp_path):
    with open_workers(tmp_path, workers=None, scheduler=None) as client:
        kept = client.run(lambda: tuple(os.sched_getaffinity(0)))
        # What keeps the call stacks of an hour grows all that time.
        profiled = client.run(lambda: dask.config.get("distributed.worker.profile.enabled"))
    assert not any(profiled.values())
    assert sorted(kept.values()) == [(core,) for core in sorted(os.sched_getaffinity(0))]


def test_a_worker_that_seems_to_stand_still_is_asked_where_its_threads_are(tmp_path):
    def told():
        # What follows the last end of a line is still being written.
        logs = (tmp_path / "logs").glob("worker-*.log")
        lines = (line for log in logs for line in log.read_text().split("\n")[:-1])
        return [event["threads"] for event in map(json.loads, lines) if "threads" in event]

    with open_workers(tmp_path, workers=1, scheduler=None) as client:
        (pid,) = client.run(os.getpid).values()
        os.kill(pid, signal.SIGUSR1)
        deadline = time.monotonic() + SECONDS
        while not told() and time.monotonic() < deadline:
            time.sleep(0.05)
        # It went on all the same.
        assert list(client.run(os.getpid).values()) == [pid]
    assert any(thread.startswith("MainThread") for thread in told()[0])
