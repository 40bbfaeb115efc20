"""Speed-up of variants of one rig that play together, in the lanes of vectors, over sequential playing."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final
from unittest.mock import patch

import numpy as np
import yaml
from drives import noise_drive, playable_share

from rig_sim import Rig, load_rig, play_batch, shipped_specimens
from rig_sim.compile import widest_lanes
from rig_sim.specimen import read_document

RIG: Final = "front_axle"
SECONDS: Final = 10.0
#: The best of them counts: what else the machine does can only make a playback slower.
REPETITIONS: Final = 15
_STEP: Final = 0.03


def measure_lanes() -> dict[str, float | None]:
    """Measure the shipped axle and variants of it, on one core.

    Returns
    -------
    dict
        `rtf`: simulated seconds of one rig per second of the processor. `four_over_one`, `eight_over_one`: those of so
        many variants together over that; None where a vector has no so many doubles. `error`: the worst response's RMS
        error of the variants over its RMS about the rest, against each alone.
    """
    with tempfile.TemporaryDirectory() as folder:
        rigs = [load_rig(path) for path in _variants(Path(folder), count=8 if widest_lanes() >= 8 else 4)]
    drive = noise_drive(rigs[0], seconds=SECONDS, share=playable_share(rigs[0]))
    works: dict[int, Callable[[], object]] = {1: lambda: _alone(rigs[0], drive)}
    for count in (4, 8):
        if widest_lanes() >= count:
            works[count] = lambda count=count: _together(rigs[:count], drive)
    # Four with AVX2 are two in a vector of four doubles, also where the processor has eight.
    with patch("rig_sim.compile.lane_model.widest_lanes", return_value=min(widest_lanes(), 4)):
        _together(rigs[:4], drive)  # compiles them; what is compiled is kept
    error = max(
        _error(rig, together, _alone(rig, drive))
        for rig, together in zip(rigs[:4], _together(rigs[:4], drive), strict=True)
    )
    # In turn, so that what else the machine does hits all alike.
    seconds: dict[int, list[float]] = {count: [] for count in works}
    for _ in range(REPETITIONS):
        for count, work in works.items():
            began = time.process_time()
            work()
            seconds[count].append(time.process_time() - began)
    rate = {count: count * SECONDS / min(found) for count, found in seconds.items()}
    return {
        "rtf": rate[1],
        "four_over_one": rate[4] / rate[1] if 4 in rate else None,
        "eight_over_one": rate[8] / rate[1] if 8 in rate else None,
        "error": error,
    }


def _variants(folder: Path, *, count: int) -> list[Path]:
    """Write the rig with lateral actuators that grow from one to the next."""
    shipped = shipped_specimens()[RIG]
    shutil.copytree(shipped.parent, folder, dirs_exist_ok=True)
    kind = read_document(shipped)["actuator_kinds"]["lateral"]
    paths = []
    for number in range(count):
        more = 1.0 + _STEP * number
        lateral = {
            "valve": {"rated_flow": more * kind["valve"]["rated_flow"]},
            "cylinder": {"dead_volume": more * kind["cylinder"]["dead_volume"]},
        }
        paths.append(folder / f"variant_{number}.yaml")
        variant = {"variant_of": shipped.name, "actuator_kinds": {"lateral": lateral}}
        paths[-1].write_text(yaml.safe_dump(variant), encoding="utf-8")
    return paths


def _alone(rig: Rig, drive: np.ndarray) -> np.ndarray:
    playback = rig.playback(drive, seed=1)
    for _ in playback.blocks():
        pass
    return playback.response


def _together(rigs: Sequence[Rig], drive: np.ndarray) -> list[np.ndarray]:
    playbacks = [rig.playback(drive, seed=1) for rig in rigs]
    for fault in play_batch(playbacks):
        if fault is not None:
            raise fault
    return [playback.response for playback in playbacks]


def _error(rig: Rig, response: np.ndarray, expected: np.ndarray) -> float:
    motion = expected - rig.static_response[:, None]
    return float(np.max(np.sqrt(np.mean((response - expected) ** 2, axis=1) / np.mean(motion**2, axis=1))))


if __name__ == "__main__":
    import json
    import sys

    sys.stdout.write(json.dumps(measure_lanes(), indent=2) + "\n")
