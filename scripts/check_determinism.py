"""Run the shipped demo campaign twice and compare the bytes of every drive and response."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path

import duralab

CAMPAIGN = "front_axle_demo"


def campaign_hashes(folder: Path) -> list[tuple[str, str]]:
    """Run the campaign into a folder and return the SHA-256 of each playback's drive and response."""
    command = [sys.executable, "-m", "duralab", "run", CAMPAIGN, "--out", str(folder)]
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    if finished.returncode not in (0, 3):  # 3: finished, but the target was not reached
        raise SystemExit(f"`duralab run {CAMPAIGN}` ended with {finished.returncode}:\n{finished.stderr}")
    recording = duralab.open_recording(folder / "recording.mcap")
    records = []
    # The blocks of the first run are the experiment that identified the rig.
    for what, signals in zip(("drive", "response"), recording.signal(recording.runs[0]), strict=True):
        records.append((f"identification, {what}", signals))
    for number in recording.iterations.numbers:
        playback = recording.playback(number)
        records += [
            (f"iteration {number}, drive", playback.drive),
            (f"iteration {number}, response", playback.response),
        ]
    return [(what, hashlib.sha256(signals.samples.tobytes()).hexdigest()) for what, signals in records]


def main() -> int:
    """Return 0 if both campaigns gave the same bytes, else name the first difference and return 1."""
    with tempfile.TemporaryDirectory() as folder:
        first, second = (campaign_hashes(Path(folder, name)) for name in ("first", "second"))
    if not first or len(first) != len(second):
        sys.stderr.write(f"The campaigns hold {len(first)} and {len(second)} records; they must be alike.\n")
        return 1
    for (what, one), (_, other) in zip(first, second, strict=True):
        if one != other:
            sys.stderr.write(f"{what} differs between two campaigns with one seed: {one} and {other}.\n")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
