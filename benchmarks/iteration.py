"""Speed of an update of the drive on one core, beside the transforms it cannot do without: a section of `bench.py`.

`python benchmarks/iteration.py` writes it alone.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from inverse_problem import BLOCK, CHANNELS, HIGHEST, LOWEST, RATE, SECONDS, rig_and_target
from peer_environments import PEERS, PeerMissingError, peer_arrays, run_on_one_core
from scipy import fft

from duralab_settings import UpdateKind
from duralab_spectra import line_frequencies
from iterator import UPDATES, IterationHistory, Playback, RigModel, UpdateSettings, control_band, rig_model
from iterator.model import ODD_TERMS

BAND = control_band(LOWEST, HIGHEST, sample_rate=RATE)
PLAYBACKS = 10
LENGTHS = (30.0, 120.0, 480.0)
CHANNEL_COUNTS = (2, 4, 8, 16)
REPETITIONS = 7


def measure_iteration(directory: Path) -> dict[str, object]:
    """Measure in a separate process, with one thread on one core.

    Parameters
    ----------
    directory : Path
        Where the peer's environment is kept.

    Returns
    -------
    dict
        Times in s; of the peer also how far its drive is from ours, RMS over RMS.
    """
    own = json.loads(run_on_one_core([sys.executable, __file__, "--own"]))
    return {**own, "peers": {"sdynpy": _peer(directory, own["first_drive_seconds"])}}


def _peer(directory: Path, own_seconds: float) -> dict[str, object]:
    try:
        arrays = peer_arrays("sdynpy", "inverse_peer.py", directory=directory)
    except PeerMissingError as error:
        return {"skipped": str(error)}
    methods = ("cola", "single_frame")
    seconds = {method: float(arrays[f"{method}_seconds"]) for method in methods}
    own = _first_drive()()
    return {
        "versions": list(PEERS["sdynpy"]),
        "seconds": seconds,
        # Against the faster of its methods.
        "times_faster": min(seconds.values()) / own_seconds,
        "relative_rms_difference": {
            method: float(np.linalg.norm(arrays[f"{method}_drive"] - own) / np.linalg.norm(own)) for method in methods
        },
    }


def _first_drive(*, seconds: float = SECONDS, channels: int = CHANNELS) -> Callable[[], np.ndarray]:
    """Return what computes the first drive for a target from a model."""
    frequency, frf, target = rig_and_target(seconds=seconds, channels=channels)
    model = rig_model(frequency, frf, identified_band=(0.5, 110.0))
    settings = UpdateSettings(band=BAND, iteration_gain=np.ones(channels), kind=UpdateKind.BASIC_TWR)
    history = IterationHistory(target=BAND.limit_target(target))
    return lambda: UPDATES[UpdateKind.BASIC_TWR](history, model, settings).drive


def _history(target: np.ndarray, *, power: int) -> IterationHistory:
    """Return playbacks of a rig that answers with a power of its drives, too, so that the update has work to do."""
    rng = np.random.default_rng(2)
    samples = target.shape[1]
    history = IterationHistory(target=target)
    for number in range(PLAYBACKS):
        noise = BAND.limit_response(rng.standard_normal((2 * CHANNELS, samples)))
        # Every playback comes out worse somewhere, another fifth of the record each time.
        worse = np.roll(np.arange(samples) < samples // 5, number * samples // PLAYBACKS)
        drive = target + 0.5**number * noise[CHANNELS:]
        response = target + 0.5 ** (number + 1) * (1.0 + 3.0 * worse) * noise[:CHANNELS]
        response = response + 3.0 * BAND.limit_response(drive**power)
        history = history.after(Playback(drive=drive, response=response))
    return history


def _secant(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> Callable[[], object]:
    """Return the update after the last playback, as in a campaign: its model has seen all steps but the last."""
    earlier = IterationHistory(target=history.target, playbacks=history.playbacks[:-1])
    bent = UPDATES[UpdateKind.SECANT](earlier, model, settings).model
    return lambda: UPDATES[UpdateKind.SECANT](history, bent, settings)


def _own_figures() -> dict[str, object]:
    rng = np.random.default_rng(1)
    samples = round(RATE * SECONDS)
    frequency = line_frequencies(BLOCK, RATE)
    coupling = 0.1 * rng.standard_normal((frequency.size, CHANNELS, CHANNELS)) + np.eye(CHANNELS)
    model = rig_model(frequency, coupling, identified_band=(0.5, 110.0))
    target = BAND.limit_target(rng.standard_normal((CHANNELS, samples)))
    history = _history(target, power=2)
    twr = UpdateSettings(band=BAND, iteration_gain=np.full(CHANNELS, 0.5), kind=UpdateKind.BASIC_TWR)
    kinds = {
        "basic_twr": twr,
        "basic_twr_with_acceptance": twr.model_copy(update={"accept_segments": True}),
        "adaptive_modelling": twr.model_copy(update={"kind": UpdateKind.ADAPTIVE_MODELLING}),
    }
    secant = twr.model_copy(update={"kind": UpdateKind.SECANT, "accept_segments": True})
    squares_alone = secant.model_copy(update={"secant": secant.secant.model_copy(update={"odd_terms": False})})
    of_cubes = _history(target, power=3)
    used = UPDATES[UpdateKind.SECANT](of_cubes, model, secant).model.terms
    if not set(used) & set(ODD_TERMS):
        raise RuntimeError(f"the update uses {used} on a rig of cubes; Gauss-Newton's time cannot be measured")
    length = BAND.transform_samples(samples)

    def transforms() -> None:
        fft.irfft(fft.rfft(target, length, axis=1), length, axis=1)

    works: dict[str, Callable[[], object]] = {
        name: lambda settings=settings: UPDATES[settings.kind](history, model, settings)
        for name, settings in kinds.items()
    }
    works["secant_with_acceptance"] = _secant(history, model, secant)
    works["secant_without_odd_terms"] = _secant(history, model, squares_alone)
    works["secant_by_gauss_newton"] = _secant(of_cubes, model, secant)
    works["secant_that_has_seen_no_step"] = lambda: UPDATES[UpdateKind.SECANT](history, model, secant)
    seconds = _fastest({"transforms": transforms, "first drive": _first_drive(), **works})
    alone, first = seconds.pop("transforms"), seconds.pop("first drive")
    return {
        "record": f"{SECONDS:g} s, {CHANNELS} x {CHANNELS} channels, {RATE:g} Hz, block {BLOCK}, {PLAYBACKS} playbacks",
        "transforms_seconds": alone,
        "first_drive_seconds": first,
        "first_drive_seconds_by_length": {
            f"{length:g}": _fastest({"": _first_drive(seconds=length)})[""] for length in LENGTHS
        },
        "first_drive_seconds_by_channels": {
            str(channels): _fastest({"": _first_drive(channels=channels)})[""] for channels in CHANNEL_COUNTS
        },
        "update_seconds": seconds,
        "basic_twr_over_transforms": seconds["basic_twr"] / alone,
        "secant_over_basic_twr": seconds["secant_with_acceptance"] / seconds["basic_twr"],
        "without_odd_terms_over_basic_twr": seconds["secant_without_odd_terms"] / seconds["basic_twr"],
        "gauss_newton_over_secant": seconds["secant_by_gauss_newton"] / seconds["secant_without_odd_terms"],
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
        sys.stdout.write(json.dumps(measure_iteration(Path("out/peers")), indent=2) + "\n")
