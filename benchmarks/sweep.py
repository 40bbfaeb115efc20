"""Gain of a sweep by a second core, and cost of a task: `python benchmarks/sweep.py`.

`--sweep thousand_tolerances` measures a study in which every campaign has another specimen. One core is a sweep with
one worker whose processes all keep to one core; two cores are two of each. Beside wall time, which any neighbour
spoils, the processor time of each campaign is reported: neighbours change it little.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
import yaml
from machine import machine

from duralab.sweeps import load_sweep, read_results
from duralab.sweeps.cluster import open_workers

SEEDS, TOLERANCES = "fifty_gains_and_seeds", "thousand_tolerances"
EMPTY_TASKS = 500
STILL_SECONDS = 240.0
"""24 campaigns on two cores that take longer have been seen once, and stood still for nine minutes."""
ANSWER_SECONDS = 2.0
MEMORY_SECONDS = 1.0
STILL = Path("out/sweep-still")


@dataclass(frozen=True)
class Run:
    """One sweep.

    Parameters
    ----------
    cores : int
        Cores, and workers.
    campaigns : int
        How many.
    wall_seconds : float
        From the command's start to its end.
    steady_per_second : float
        Campaigns a second between the first campaign of every worker and the last of all.
    processor_seconds : float
        Of all processes, of each campaign, with their start.
    campaign_processor_seconds : float
        Of the worker that runs it, with its cell: the middle one of those whose cell took least.
    cell_seconds, campaign_seconds : float
        Opening a cell, the longest; a campaign in one that was there, the middle one.
    mebibytes : float
        Of a recording that is kept; 0 where none is.
    worker_mebibytes : tuple of float
        Resident memory of the largest worker: the mean of the second quarter of the time, and that of the last one.
    """

    cores: int
    campaigns: int
    wall_seconds: float
    steady_per_second: float
    processor_seconds: float
    campaign_processor_seconds: float
    cell_seconds: float
    campaign_seconds: float
    mebibytes: float
    worker_mebibytes: tuple[float, float]


def run(folder: Path, *, sweep: str, cores: int, campaigns: int, cell: str) -> Run:
    """Run campaigns of a shipped sweep on this number of cores; those of `SEEDS` differ only in their seed."""
    document = yaml.safe_load(load_sweep(sweep).text) | {"cell": cell}
    if sweep == SEEDS:
        document["axes"] = {"seed": {"from": 1, "count": campaigns}}
    file = folder / "sweep.yaml"
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    command = [sys.executable, "-m", "duralab", "sweep", str(file), "--out", str(folder)]
    command += ["--workers", str(cores), "--at-most", str(campaigns)]
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    if len(allowed) < cores:
        raise SystemExit(f"{cores} cores are asked for and {len(allowed)} are here.")
    before, begun = _processor_of_children(), time.perf_counter()
    whole = os.sched_getaffinity(0)
    os.sched_setaffinity(0, allowed)
    still = STILL_SECONDS * 2 / cores * max(1.0, campaigns / 24)
    asking = threading.Timer(still, _keep_stacks, (folder / "logs",))
    asking.start()
    memory: list[float] = []
    try:
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
            while process.poll() is None:
                memory.append(_largest_worker(process.pid))
                time.sleep(MEMORY_SECONDS)
        if process.returncode:
            raise SystemExit(f"The sweep ended with exit code {process.returncode}.")
    finally:
        asking.cancel()
        os.sched_setaffinity(0, whole)
    wall, used = time.perf_counter() - begun, _processor_of_children() - before
    results = read_results(folder)
    if results.failed or len(results.finished) != campaigns:
        raise SystemExit(f"Of {campaigns} campaigns, {len(results.finished)} came to their end.")
    quarter = len(memory) // 4
    ends = sorted((folder / "points" / row["id"] / "outcome.parquet").stat().st_mtime for row in results.rows)
    warm = sorted(results.rows, key=lambda row: row["seconds_cell"])[:-cores]
    return Run(
        cores=cores,
        campaigns=campaigns,
        wall_seconds=wall,
        steady_per_second=(campaigns - cores) / (ends[-1] - ends[cores - 1]),
        processor_seconds=used / campaigns,
        campaign_processor_seconds=statistics.median(row["seconds_processor"] for row in warm),
        cell_seconds=max(row["seconds_cell"] for row in results.rows),
        campaign_seconds=statistics.median(row["seconds_campaign"] for row in warm),
        mebibytes=statistics.median(row["bytes"] for row in results.rows) / 2**20,
        worker_mebibytes=(statistics.mean(memory[quarter : 2 * quarter]), statistics.mean(memory[3 * quarter :])),
    )


def _largest_worker(command: int) -> float:
    """Return the resident MiB of the largest process that a sweep started; 0 if there is none."""
    sizes = [0.0]
    with contextlib.suppress(psutil.NoSuchProcess):
        for process in psutil.Process(command).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                sizes.append(process.memory_info().rss / 2**20)
    return max(sizes)


def _keep_stacks(logs: Path) -> None:
    """Log the call stacks of the workers of a sweep that seems to hang, and keep their logs."""
    for log in logs.glob("worker-*.log"):
        # One that died was replaced; its log is kept all the same.
        with contextlib.suppress(ProcessLookupError):
            os.kill(int(log.stem.rpartition("-")[2]), signal.SIGUSR1)
    time.sleep(ANSWER_SECONDS)
    shutil.copytree(logs, STILL, dirs_exist_ok=True)
    sys.stderr.write(f"A sweep takes long; where its threads are stands in {STILL}.\n")


def empty_task_seconds() -> float:
    """Return Dask's time for an empty task: submit, send, run, answer."""
    with tempfile.TemporaryDirectory() as folder, open_workers(Path(folder), workers=2, scheduler=None) as client:
        client.gather(client.map(abs, range(EMPTY_TASKS), pure=False))
        begun = time.perf_counter()
        client.gather(client.map(abs, range(EMPTY_TASKS), pure=False))
        return (time.perf_counter() - begun) / EMPTY_TASKS


def _processor_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure_sweep(
    *, sweep: str = SEEDS, campaigns: int = 24, on_one: int | None = None, turns: int = 2, cell: str = "process"
) -> dict[str, object]:
    """Measure one and two cores in turns; the best of them counts: a neighbour only slows.

    Parameters
    ----------
    sweep : str
        Name of a shipped one.
    campaigns : int
        Number of campaigns in each sweep.
    on_one : int, optional
        Number of campaigns on one core; the same number if not given.
    turns : int
        Of both.
    cell : str
        "process" or "lab", as in a sweep's file.

    Returns
    -------
    dict
        Every run, and what two cores do over twice what one does: without the start, with it, by processor time.
    """
    empty, runs = empty_task_seconds(), []
    for _ in range(turns):
        for cores, count in ((1, on_one or campaigns), (2, campaigns)):
            with tempfile.TemporaryDirectory() as folder:
                runs.append(run(Path(folder), sweep=sweep, cores=cores, campaigns=count, cell=cell))
    one, two = ([each for each in runs if each.cores == cores] for cores in (1, 2))
    return {
        "sweep": sweep,
        "cell": cell,
        "campaigns_per_minute": 60.0 * max(r.steady_per_second for r in two),
        "empty_task_seconds": empty,
        "efficiency_steady": max(r.steady_per_second for r in two) / (2 * max(r.steady_per_second for r in one)),
        "efficiency_with_start": min(r.wall_seconds / r.campaigns for r in one)
        / (2 * min(r.wall_seconds / r.campaigns for r in two)),
        "efficiency_by_processor_time": min(r.campaign_processor_seconds for r in one)
        / min(r.campaign_processor_seconds for r in two),
        "runs": [asdict(each) for each in runs],
    }


def main() -> None:
    """Measure and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweep", choices=(SEEDS, TOLERANCES), default=SEEDS)
    parser.add_argument("--campaigns", type=int, default=24, help="of each sweep")
    parser.add_argument("--on-one", type=int, help="of those on one core, where not as many")
    parser.add_argument("--turns", type=int, default=2)
    parser.add_argument("--cell", choices=("process", "lab"), default="process")
    given = parser.parse_args()
    figures = measure_sweep(
        sweep=given.sweep, campaigns=given.campaigns, on_one=given.on_one, turns=given.turns, cell=given.cell
    )
    sys.stdout.write(json.dumps({"machine": machine(), **figures}, indent=2) + "\n")


if __name__ == "__main__":
    main()
