"""Shares of a campaign's wall time, from its trace: simulation, mathematics, bus and disk.

The shipped campaign runs three times on a lab of five processes that write traces. Of the fastest run every moment
counts once: for the simulation where the rig plays, else for the mathematics where any process computes, else for the
rest, which is bus, disk and waiting for one another.

`python benchmarks/campaign.py` writes it alone.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import duralab
from duralab.campaign import Campaign, Target
from duralab.data import Signals
from duralab.formats import write_signals
from duralab.profile import Profile
from duralab_bus import SpanKind

CAMPAIGN = "front_axle_demo"
TURNS = 3
"""Number of runs; the fastest counts, because other load can only make a campaign slower."""


@dataclass(frozen=True)
class Shares:
    """Wall time of a campaign in s, and its shares.

    Parameters
    ----------
    rig_seconds : float
        Simulated: identification and all playbacks of the target.
    wall_seconds : float
        From the first question to the recording that is complete.
    simulation_seconds, compute_seconds, disk_seconds, service_seconds, waiting_seconds : float
        Parts of the wall time: the rig plays; else something is computed; else a recording is written or read; else a
        service does something else; else they wait for one another.
    bus_and_disk_share : float
        The last three, over the wall time.
    bus_and_disk_share_at_real_time : float
        The same seconds over those that the campaign would take on a rig that plays in real time.
    megabytes : float
        Of the recording and what lies beside it, copied to where it was asked for.
    """

    rig_seconds: float
    wall_seconds: float
    simulation_seconds: float
    compute_seconds: float
    disk_seconds: float
    service_seconds: float
    waiting_seconds: float
    bus_and_disk_share: float
    bus_and_disk_share_at_real_time: float
    megabytes: float


def measure_campaign() -> dict[str, object]:
    """Run the shipped campaign and read its trace.

    Returns
    -------
    dict
        Of `Shares`, of the fastest turn.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        traces = folder / "traces"
        traces.mkdir()
        with duralab.start(folder / "lab", trace_folder=traces) as lab:
            recording = lab.run(CAMPAIGN, out=folder / "first").recording
            # Not the road and its vehicle again: they are another rig's work.
            write_signals(Signals.from_message(recording.specification.target), folder / "target.parquet")
            shipped = duralab.load_campaign(CAMPAIGN)
            target = Target(file=folder / "target.parquet")
            turns = [shipped.model_copy(update={"name": f"turn{turn}", "target": target}) for turn in range(TURNS)]
            ran = [_ran(lab, turn, folder / turn.name) for turn in turns]
        began, ended, out = min(ran, key=lambda each: each[1] - each[0])
        copied = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
        spent = Profile.read(traces).shares(began, ended)
        samples = sum(recording.signal(run)[0].samples.shape[1] for run in recording.runs)
    rig_seconds, wall = samples / recording.rig.sample_rate, ended - began
    simulation, compute = spent[SpanKind.PLAYBACK], spent[SpanKind.MATHEMATICS]
    rest = wall - simulation - compute
    return asdict(
        Shares(
            rig_seconds=rig_seconds,
            wall_seconds=wall,
            simulation_seconds=simulation,
            compute_seconds=compute,
            disk_seconds=spent[SpanKind.DISK],
            service_seconds=spent[SpanKind.SERVICE],
            waiting_seconds=spent[SpanKind.WAITING],
            bus_and_disk_share=rest / wall,
            bus_and_disk_share_at_real_time=rest / (rig_seconds + compute + rest),
            megabytes=copied / 1e6,
        )
    )


def _ran(lab: duralab.Lab, campaign: Campaign, out: Path) -> tuple[float, float, Path]:
    """Return the times of a campaign's request and of its complete recording, in s since 1970, and the path."""
    began = time.time()
    lab.run(campaign, out=out)
    return began, time.time(), out


if __name__ == "__main__":
    sys.stdout.write(json.dumps(measure_campaign(), indent=2) + "\n")
