"""Measure the live view: scalars a second into its file, and what its process keeps."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import array_pb2, iterator_pb2, rig_pb2
from recorder.live import LiveView

CHANNELS = 8
SAMPLE_RATE = 2000.0
BLOCK = 100
SECONDS = 60.0
REPEATS = 3


@dataclass(frozen=True)
class LiveFigures:
    """Scalars that blocks carry and that the view draws of them, a second of wall time; and its file, in MiB."""

    scalars: int
    scalars_per_second: float
    drawn_per_second_of_run: float
    file_mebibytes: float


def measure_live_view() -> dict[str, object]:
    """Show a run of 8 drives and 8 responses at 2 kHz, block by block, to a file; the median of three."""
    runs = sorted((_measure() for _ in range(REPEATS)), key=lambda figures: figures.scalars_per_second)
    return asdict(runs[REPEATS // 2])


def _measure() -> LiveFigures:
    rng = np.random.default_rng(1)
    samples = round(SECONDS * SAMPLE_RATE)
    signals = rng.standard_normal((CHANNELS, samples))
    channels = [array_pb2.Channel(name=f"channel_{n}", unit="N", minimum=-10, maximum=10) for n in range(CHANNELS)]
    blocks = [
        rig_pb2.SignalBlock(
            run="bench.i01",
            first_sample=first,
            sample_rate=SAMPLE_RATE,
            drive=to_array(np.ascontiguousarray(signals[:, first : first + BLOCK])),
            response=to_array(np.ascontiguousarray(signals[:, first : first + BLOCK])),
            last=first + BLOCK >= samples,
        )
        for first in range(0, samples, BLOCK)
    ]
    # Without a band every sample is drawn: the view's speed, and not that of leaving things out.
    specification = iterator_pb2.CampaignSpec(
        id="bench", rig="bench", target=to_record(channels, SAMPLE_RATE, signals[:, : round(SAMPLE_RATE)])
    )
    description = rig_pb2.RigDescription(rig="bench", sample_rate=SAMPLE_RATE, drives=channels, responses=channels)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bench.rrd"
        view = LiveView("bench", file=file, viewer=None)
        view.show_step(specification)
        view.show_step(description)
        began = time.perf_counter()
        for block in blocks:
            view.show_block(block)
        # Everything is in the file when it is closed.
        view.close()
        seconds = time.perf_counter() - began
        size = file.stat().st_size
    scalars = 2 * CHANNELS * samples
    return LiveFigures(scalars, scalars / seconds, scalars / SECONDS, size / 2**20)


if __name__ == "__main__":
    sys.stdout.write(json.dumps(measure_live_view(), indent=2) + "\n")
