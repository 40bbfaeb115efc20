"""The recorder's log without a bus: writing, opening a window, verifying, repairing. A section of `bench.py`.

`python benchmarks/recording.py [--seconds S] [--folder DIR]` measures it alone, on the disk of a folder.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from duralab_bus import StreamItem
from duralab_proto.arrays import to_array
from duralab_proto.keys import Keys
from duralab_proto.v1 import array_pb2, recorder_pb2, rig_pb2
from duralab_recordings import forget_indexes
from recorder.format import Step, decode_step, files_of
from recorder.log import Archive
from recorder.reading import read_window, verify

CHANNELS, SAMPLE_RATE, BLOCK = 8, 2000.0, 100
"""Drives, and as many responses: blocks of 12.8 KB."""
SECONDS, WINDOW_SECONDS, WINDOWS = 800.0, 10.0, 31
SYNC_SECONDS = 0.25
RUN = "bench.i01"


def _step(
    number: int, message: recorder_pb2.RunPlanned | rig_pb2.RigDescription | recorder_pb2.RecordingClosed
) -> Step:
    return decode_step(
        recorder_pb2.CommitRequest(
            recording="bench",
            step=number,
            message_type=message.DESCRIPTOR.full_name,
            payload=message.SerializeToString(),
        )
    )


def _description() -> rig_pb2.RigDescription:
    def channels(kind: str) -> list[array_pb2.Channel]:
        return [array_pb2.Channel(name=f"{kind}_{row}", unit="1", minimum=-1, maximum=1) for row in range(CHANNELS)]

    return rig_pb2.RigDescription(
        rig="bench",
        sample_rate=SAMPLE_RATE,
        drives=channels("drive"),
        responses=channels("response"),
        static_response=to_array(np.zeros(CHANNELS)),
    )


def _items(seconds: float) -> list[StreamItem[rig_pb2.SignalBlock]]:
    """Return a run's blocks, of noise, which no compression makes smaller."""
    generator = np.random.default_rng(6)
    key = Keys().rig_signal("bench", RUN)
    items = []
    for seq in range(int(seconds * SAMPLE_RATE) // BLOCK):
        drive, response = generator.standard_normal((2, CHANNELS, BLOCK))
        block = rig_pb2.SignalBlock(
            run=RUN,
            first_sample=seq * BLOCK,
            sample_rate=SAMPLE_RATE,
            drive=to_array(drive),
            response=to_array(response),
        )
        items.append(StreamItem(key, 1, seq, block, block.SerializeToString()))
    items[-1].message.last = True
    return items


def measure_recorder(folder: Path, *, seconds: float = SECONDS) -> dict[str, float]:
    """Measure the log on a folder's disk; the folder is empty.

    Returns
    -------
    dict
        Blocks a second and megabytes a second through checks, log and fsync every 0.25 s; the longest that the writer
        was held up; milliseconds to a window of 10 s out of all, the median and the largest of 31, each from the
        files' first byte on; megabytes a second of `verify` and of a repair.
    """
    archive = Archive(folder, split_bytes=2**30, least_free_bytes=0)
    for number, message in enumerate((_description(), recorder_pb2.RunPlanned(run=RUN, rig="bench"))):
        archive.commit("bench", _step(number, message))
    items = _items(seconds)
    longest, due, begin = 0.0, time.perf_counter() + SYNC_SECONDS, time.perf_counter()
    for item in items:
        before = time.perf_counter()
        archive.take_block(item)
        if before >= due:
            archive.sync()
            due = before + SYNC_SECONDS
        longest = max(longest, time.perf_counter() - before)
    archive.sync()
    writing = time.perf_counter() - begin
    killed = folder / "killed"
    killed.mkdir()
    shutil.copy(folder / "bench.mcap", killed)
    archive.commit("bench", _step(2, recorder_pb2.RecordingClosed(reason="measured")))
    size = sum(path.stat().st_size for path in files_of(folder, "bench")) / 1e6
    windows = _windows(folder, seconds)
    begin = time.perf_counter()
    if not verify(folder, "bench").whole:
        raise RuntimeError("The recording that was written is not whole.")
    verifying = time.perf_counter() - begin
    begin = time.perf_counter()
    Archive(killed).recover()
    repairing = time.perf_counter() - begin
    return {
        "blocks_per_second": len(items) / writing,
        "megabytes_per_second": size / writing,
        "longest_stall_ms": 1e3 * longest,
        "window_median_ms": 1e3 * float(np.median(windows)),
        "window_largest_ms": 1e3 * max(windows),
        "verify_megabytes_per_second": size / verifying,
        "repair_megabytes_per_second": size / repairing,
    }


def _windows(folder: Path, seconds: float) -> list[float]:
    taken = []
    for first in np.random.default_rng(7).uniform(0.0, seconds - WINDOW_SECONDS, WINDOWS):
        request = recorder_pb2.SignalWindowRequest(run=RUN, first_second=first, seconds=WINDOW_SECONDS)
        forget_indexes()
        begin = time.perf_counter()
        window = read_window(folder, "bench", request)
        taken.append(time.perf_counter() - begin)
        if window.response.samples.shape[1] != round(WINDOW_SECONDS * SAMPLE_RATE):
            raise RuntimeError("A window has not the samples that it should have.")
    return taken


def main() -> None:
    """Measure on the disk of the folder for temporary files, or of another."""
    parser = argparse.ArgumentParser(description="Measure the recorder's log.")
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--folder", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        figures = measure_recorder(Path(folder), seconds=arguments.seconds)
    sys.stdout.write(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
