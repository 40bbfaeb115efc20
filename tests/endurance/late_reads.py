"""Time to read late in an endurance test: the catalogue, a recording opened, a window of samples."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import duralab
from duralab_proto.v1 import recorder_pb2

from .disturbed_test import volumes
from .killable_services import KillableServices

EARLY, EARLY_REPEATS = "early", 100
_TRIES = 25


def read_seconds(services: KillableServices, recording: str) -> dict[str, float]:
    """Return the median time of each kind of read; `recording` is the one that is read."""
    bus = services.bus
    path = services.recordings / f"{recording}.mcap"
    kept = [message.run for message in duralab.open_recording(path).messages(recorder_pb2.RunPlayed)]
    window = recorder_pb2.SignalWindowRequest(run=kept[-1], seconds=1.0)

    def seconds(read: Callable[[], object]) -> float:
        times = []
        for _ in range(_TRIES):
            begun = time.perf_counter()
            read()
            times.append(time.perf_counter() - begun)
        return statistics.median(times)

    listed = recorder_pb2.ListRecordingsRequest()
    return {
        "catalogue": seconds(lambda: bus.query(bus.keys.recordings(), listed, recorder_pb2.RecordingList)),
        "opening": seconds(lambda: duralab.open_recording(path)),
        "window": seconds(lambda: bus.query(bus.keys.recording_signals(recording), window, recorder_pb2.SignalWindow)),
    }


def late_reads(services: KillableServices, id: str, early: dict[str, float]) -> str:
    """Return what reads take after an endurance test, over those of a short test before it and of its first recording.

    A recording holds a bounded number of repeats: opening it grows up to there, and no more.
    """
    names = volumes(services, id)
    first, last = read_seconds(services, names[0]), read_seconds(services, names[-1])
    return "\n".join(
        f"{what}: {1e3 * seconds:.1f} ms in the last of {len(names)} recordings, {seconds / first[what]:.2f} times "
        f"that of the first, {seconds / early[what]:.2f} times that after {EARLY_REPEATS} repeats in all"
        for what, seconds in last.items()
    )
