"""A recording that was killed with gibibytes of room behind it is recovered quickly, and with little memory."""

import os
import tracemalloc
from contextlib import closing

from recorder.format import DAMAGED_FOLDER
from recorder.reading import verify

from ..test_recovery import begun, go_on, killed


def test_gibibytes_of_zeros_behind_a_killed_recording_take_neither_time_nor_memory(tmp_path, campaign, step_of):
    with closing(begun(tmp_path, campaign, step_of)):
        folder = killed(tmp_path, tmp_path / "after")
    whole = (folder / "demo.mcap").read_bytes()
    os.truncate(folder / "demo.mcap", 2**31)
    tracemalloc.start()
    try:
        go_on(folder, campaign, step_of)
        assert tracemalloc.get_traced_memory()[1] < 64 * 2**20
    finally:
        tracemalloc.stop()
    assert verify(folder, "demo").whole
    kept = folder / DAMAGED_FOLDER / "demo.mcap"
    assert (kept.stat().st_size, kept.stat().st_blocks * 512 < 2**24) == (2**31, True)
    with kept.open("rb") as stream:
        assert stream.read(len(whole)) == whole
