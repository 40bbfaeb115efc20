"""Where the wall time of a whole campaign goes: simulation, compute, bus and disk; and how its parts grow.

The shipped campaign runs on a lab of five processes. Then what it recorded is gone through again by the cores alone, in
one process and without bus and files: each drive is played, the model estimated, each next drive computed from the
recorded responses. What the campaign took beyond that is bus, disk and waiting for one another.

`python benchmarks/campaign.py` writes it alone.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from campaign_time import seconds_by_activity

import duralab
from duralab.campaign import Campaign, Target
from duralab.data import Signals
from duralab.formats import write_signals
from duralab_proto.v1 import identifier_pb2
from identifier.bus import settings_of
from identifier.excitation import design_experiment
from identifier.experiment import estimate_experiment
from iterator import iterate
from iterator.campaign import checked_model, identification_request, plan_campaign
from rig_sim import load_any_rig, shipped_specimens

CAMPAIGN = "front_axle_demo"
TURNS = 3
"""The fastest of them counts: what else the machine does can only make a campaign slower."""


@dataclass(frozen=True)
class Shares:
    """Wall time of a campaign in s, of what its cores need alone, and what share of it the rest is.

    Parameters
    ----------
    rig_seconds : float
        Simulated: identification and all playbacks of the target.
    wall_seconds : float
        From the first question to the recording that is complete.
    simulation_seconds, compute_seconds : float
        Of the cores alone.
    bus_and_disk_share : float
        What is neither, over the wall time.
    bus_and_disk_share_at_real_time : float
        The same seconds over those that the campaign would take on a rig that plays in real time.
    megabytes : float
        Of the recording and what lies beside it, copied to where it was asked for.
    spent : dict
        The wall time by what the iterator said that it was doing, in s; see `seconds_by_activity`.
    """

    rig_seconds: float
    wall_seconds: float
    simulation_seconds: float
    compute_seconds: float
    bus_and_disk_share: float
    bus_and_disk_share_at_real_time: float
    megabytes: float
    spent: dict[str, float]


def measure_campaign() -> dict[str, object]:
    """Run the shipped campaign and its cores.

    Returns
    -------
    dict
        Of `Shares`, of the fastest turn.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with duralab.start(folder / "lab") as lab:
            recording = lab.run(CAMPAIGN, out=folder / "first").recording
            # Not the road and its vehicle again: they are another rig's work.
            write_signals(Signals.from_message(recording.specification.target), folder / "target.parquet")
            shipped = duralab.load_campaign(CAMPAIGN)
            target = Target(file=folder / "target.parquet")
            turns = [shipped.model_copy(update={"name": f"turn{turn}", "target": target}) for turn in range(TURNS)]
            ran = [_ran(lab, turn, folder / turn.name) for turn in turns]
        began, ended, out = min(ran, key=lambda each: each[1] - each[0])
        wall = ended - began
        copied = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
        spent = seconds_by_activity(out / "recording.mcap", began=began, ended=ended)
        rig_seconds, simulation = _simulation(recording)
        mathematics = _mathematics(recording)
        compute = min(_timed(mathematics) for _ in range(TURNS))
    rest = wall - simulation - compute
    return asdict(
        Shares(
            rig_seconds=rig_seconds,
            wall_seconds=wall,
            simulation_seconds=simulation,
            compute_seconds=compute,
            bus_and_disk_share=rest / wall,
            bus_and_disk_share_at_real_time=rest / (rig_seconds + compute + rest),
            megabytes=copied / 1e6,
            spent=spent,
        )
    )


def _ran(lab: duralab.Lab, campaign: Campaign, out: Path) -> tuple[float, float, Path]:
    """Return when a campaign was asked for and when its recording was there, in s since 1970, and where that is."""
    began = time.time()
    lab.run(campaign, out=out)
    return began, time.time(), out


def _simulation(recording: duralab.Recording) -> tuple[float, float]:
    """Return how many seconds were played, and how many the rig's core takes for them."""
    rig = load_any_rig(shipped_specimens()[recording.rig.rig])
    drives = [recording.signal(run)[0].samples for run in recording.runs]

    def play() -> None:
        for drive in drives:
            for _ in rig.playback(drive, seed=1).blocks():
                pass

    samples = sum(drive.shape[1] for drive in drives)
    return samples / recording.rig.sample_rate, min(_timed(play) for _ in range(TURNS))


def _mathematics(recording: duralab.Recording) -> Callable[[], None]:
    """Return what designs the experiment, estimates the model and computes every drive, from what was measured then.

    All that it needs is read before: reading a log is no part of the mathematics.
    """
    specification, description = recording.specification, recording.rig
    model = next(recording.messages(identifier_pb2.Model))
    settings = settings_of(identification_request(specification, run=model.run, check_only=False))
    drive, response = (record.samples for record in recording.signal(model.run))
    playbacks = [recording.playback(number).response.samples for number in recording.iterations.numbers]

    def compute() -> None:
        experiment = design_experiment(
            settings.excitation, drives=len(description.drives), sample_rate=description.sample_rate
        )
        estimate_experiment(settings.estimator, experiment.layout, drive=drive, response=response)
        plan = plan_campaign(specification, description, model.plan)
        measured = iter(playbacks)
        for _ in iterate(
            lambda _drive: next(measured),
            plan.target_in_band,
            model=checked_model(model, plan=plan),
            settings=plan.settings,
            limits=plan.limits,
        ):
            pass

    return compute


def _timed(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


if __name__ == "__main__":
    sys.stdout.write(json.dumps(measure_campaign(), indent=2) + "\n")
