"""Speed of an update of the drive on one core, beside the transforms it cannot do without: a section of `bench.py`.

`python benchmarks/iteration.py` writes it alone.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import fft

from iterator import (
    UPDATES,
    AcceptanceSettings,
    IterationHistory,
    Playback,
    UpdateKind,
    UpdateSettings,
    control_band,
    rig_model,
)
from spectra import line_frequencies

RATE, SECONDS, CHANNELS, BLOCK = 1000.0, 120.0, 8, 2048
BAND = control_band(1.0, 100.0, sample_rate=RATE)
PLAYBACKS = 10
REPETITIONS = 7


def measure_iteration() -> dict[str, object]:
    """Measure in a process of its own, with one thread on one core.

    Returns
    -------
    dict
        Times in s.
    """
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--own"]
    ran = subprocess.run(command, env=environment, capture_output=True, check=True, text=True)
    return json.loads(ran.stdout)


def _own_figures() -> dict[str, object]:
    rng = np.random.default_rng(1)
    samples = round(RATE * SECONDS)
    frequency = line_frequencies(BLOCK, RATE)
    coupling = 0.1 * rng.standard_normal((frequency.size, CHANNELS, CHANNELS)) + np.eye(CHANNELS)
    model = rig_model(frequency, coupling, identified_band=(0.5, 110.0))
    target = BAND.limit_target(rng.standard_normal((CHANNELS, samples)))
    history = IterationHistory(target=target)
    for number in range(PLAYBACKS):
        noise = BAND.limit_response(rng.standard_normal((2 * CHANNELS, samples)))
        # Every playback comes out worse somewhere, another fifth of the record each time.
        worse = np.roll(np.arange(samples) < samples // 5, number * samples // PLAYBACKS)
        response = target + 0.5 ** (number + 1) * (1.0 + 3.0 * worse) * noise[:CHANNELS]
        history = history.after(Playback(drive=target + 0.5**number * noise[CHANNELS:], response=response))
    twr = UpdateSettings(band=BAND, iteration_gain=np.full(CHANNELS, 0.5), kind=UpdateKind.BASIC_TWR)
    kinds = {
        "basic_twr": twr,
        "basic_twr_with_acceptance": replace(twr, acceptance=AcceptanceSettings()),
        "adaptive_modelling": replace(twr, kind=UpdateKind.ADAPTIVE_MODELLING),
        "secant_with_acceptance": replace(twr, kind=UpdateKind.SECANT, acceptance=AcceptanceSettings()),
    }
    length = BAND.transform_samples(samples)

    def transforms() -> None:
        fft.irfft(fft.rfft(target, length, axis=1), length, axis=1)

    # As in a campaign: the model comes from the update before, which has seen all steps but the last.
    earlier = IterationHistory(target=target, playbacks=history.playbacks[:-1])
    bent = UPDATES[UpdateKind.SECANT](earlier, model, kinds["secant_with_acceptance"]).model
    works: dict[str, Callable[[], object]] = {
        name: lambda settings=settings: UPDATES[settings.kind](
            history, bent if settings.kind is UpdateKind.SECANT else model, settings
        )
        for name, settings in kinds.items()
    }
    works["secant_that_has_seen_no_step"] = lambda: UPDATES[UpdateKind.SECANT](
        history, model, kinds["secant_with_acceptance"]
    )
    seconds = _fastest({"transforms": transforms, **works})
    alone = seconds.pop("transforms")
    return {
        "record": f"{SECONDS:g} s, {CHANNELS} x {CHANNELS} channels, {RATE:g} Hz, block {BLOCK}, {PLAYBACKS} playbacks",
        "transforms_seconds": alone,
        "update_seconds": seconds,
        "basic_twr_over_transforms": seconds["basic_twr"] / alone,
        "secant_over_basic_twr": seconds["secant_with_acceptance"] / seconds["basic_twr"],
    }


def _fastest(works: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Take turns, so that a neighbour of a busy machine slows all of them alike."""
    rounds = [{name: _timed(work) for name, work in works.items()} for _ in range(REPETITIONS)]
    return {name: min(seconds[name] for seconds in rounds) for name in works}


def _timed(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


if __name__ == "__main__":
    if "--own" in sys.argv:
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        sys.stdout.write(json.dumps(_own_figures()))
    else:
        sys.stdout.write(json.dumps(measure_iteration(), indent=2) + "\n")
