"""Speed, memory and results of the identifier on one core, beside scipy and the peers: a section of `bench.py`.

`python benchmarks/identification.py` writes it alone. Peers are measured in environments of their own under out/peers.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from identification_peer import CHANNELS, COMPARED_SECONDS, HALF_WIDTH, LOCAL_SECONDS, SECONDS
from identification_records import BLOCK, OVERLAP, RATE, noise_record, resonant_record, scaled_record
from peer_environments import PEERS, PeerMissingError, peer_arrays, run_on_one_core
from processes import resident_bytes
from scipy import fft, signal

from duralab_settings import EstimatorKind
from duralab_spectra import CrossSpectra, SpectraEstimate, hann_periodic
from identifier import Capture, EstimatorOptions, FrfEstimate, Layout, Window, estimate

REPETITIONS, TURNS, PAIR_LOOPS = 7, 25, 3
PIECE_SECONDS = 20.0


def measure_identification(directory: Path) -> dict[str, object]:
    """Measure everything on one core; peers that cannot be installed are listed with the reason.

    Parameters
    ----------
    directory : Path
        Where the peers' environments are kept.

    Returns
    -------
    dict
        Times in s, memory in MiB, differences relative to the largest element of an FRF.
    """
    own = json.loads(run_on_one_core([sys.executable, __file__, "--own"]))
    return {**own, "peers": {name: _peer(name, directory, own["h1_seconds"]) for name in PEERS}}


def _own_figures() -> dict[str, object]:
    drive, response = noise_record(seconds=SECONDS, channels=CHANNELS)
    layout = noise_layout(drive.shape[1], lowest=1.0, highest=499.0)
    _spectra(drive[:, : 10 * BLOCK], response[:, : 10 * BLOCK])
    growth = _memory_growth(lambda: _spectra(drive, response))
    whole_growth = _memory_growth(lambda: estimate(EstimatorKind.H1, drive, response, layout))
    # In turns, so that a neighbour of a busy machine slows all of them alike.
    works: tuple[Callable[[], object], ...] = (
        lambda: _spectra(drive, response),
        lambda: _windowed_transforms(drive, response),
        lambda: _plain_windowed_transforms(drive, response),
        lambda: estimate(EstimatorKind.H1, drive, response, layout),
    )
    turns = [[_timed_warm(work) for work in works] for _ in range(TURNS)]
    spectra, transforms, plain, h1 = (min(times) for times in zip(*turns, strict=True))
    pairs = min(_timed(lambda: _csd_pairs(drive, response)) for _ in range(PAIR_LOOPS))
    return {
        "spectra_seconds": spectra,
        "windowed_transforms_seconds": transforms,
        "over_windowed_transforms": spectra / transforms,
        "plain_windowed_transforms_seconds": plain,
        "over_plain_windowed_transforms": spectra / plain,
        "csd_pairs_seconds": pairs,
        "times_faster_than_csd_pairs": pairs / spectra,
        "spectra_memory_mebibytes": growth,
        "h1_memory_mebibytes": whole_growth,
        "h1_seconds": h1,
        "local_rational_6x6_240_s_seconds": _local_seconds(),
        "streamed_seconds": {f"{seconds:g}": _streamed(seconds) for seconds in (60.0, 600.0, 6000.0)},
        "spectra_seconds_by_channels": {str(channels): _of_channels(channels) for channels in (2, 4, 8, 16)},
    }


def _spectra(drive: np.ndarray, response: np.ndarray) -> SpectraEstimate:
    running = _running(drive.shape[0])
    running.add(response, drive)
    return running.estimate()


def _running(channels: int) -> CrossSpectra:
    return CrossSpectra(channels, channels, block_samples=BLOCK, overlap=OVERLAP, sample_rate=RATE)


def _windowed_transforms(drive: np.ndarray, response: np.ndarray) -> None:
    """Window and transform the same blocks at numpy's best speed: a few at a time into allocated memory."""
    window, hop, together = hann_periodic(BLOCK), round(BLOCK * (1.0 - OVERLAP)), 16
    windowed = np.empty((together, BLOCK))
    lines = np.empty((together, BLOCK // 2 + 1), dtype=complex)
    for channel in (*response, *drive):
        frames = np.lib.stride_tricks.sliding_window_view(channel, BLOCK)[::hop]
        for start in range(0, len(frames), together):
            some = frames[start : start + together]
            np.multiply(some, window, out=windowed[: len(some)])
            np.fft.rfft(windowed[: len(some)], out=lines[: len(some)])


def _plain_windowed_transforms(drive: np.ndarray, response: np.ndarray) -> None:
    """Window and transform the same blocks as one would write it down: all blocks of a channel by scipy.fft."""
    window, hop = hann_periodic(BLOCK), round(BLOCK * (1.0 - OVERLAP))
    for channel in (*response, *drive):
        fft.rfft(np.lib.stride_tricks.sliding_window_view(channel, BLOCK)[::hop] * window)


def _csd_pairs(drive: np.ndarray, response: np.ndarray) -> None:
    """Estimate the same, ``S_yu``, ``S_uu`` and the diagonal of ``S_yy``, by a loop of scipy.signal.csd over pairs."""
    chosen = {"fs": RATE, "window": "hann", "nperseg": BLOCK, "noverlap": round(BLOCK * OVERLAP), "detrend": False}
    for first in drive:
        for second in (*response, *drive):
            signal.csd(first, second, **chosen)
    for channel in response:
        signal.csd(channel, channel, **chosen)


def _local_seconds() -> float:
    drive, response = noise_record(seconds=240.0, channels=6)
    layout = noise_layout(drive.shape[1], lowest=0.5, highest=50.0)
    return _timed(lambda: estimate(EstimatorKind.LOCAL_RATIONAL, drive, response, layout))


def _of_channels(channels: int) -> float:
    """Return the time of averaging 60 s of this number of drives and of responses."""
    drive, response = noise_record(seconds=60.0, channels=channels)
    return _best(lambda: _spectra(drive, response))


def _streamed(seconds: float) -> float:
    """Return the time of averaging alone, the record fed in pieces that are made as they are needed."""
    running = _running(CHANNELS)
    drive, response = noise_record(seconds=PIECE_SECONDS, channels=CHANNELS)
    total = 0.0
    for _ in range(round(seconds / PIECE_SECONDS)):
        total += _timed(lambda: running.add(response, drive))
    return total + _timed(running.estimate)


def noise_layout(samples: int, *, lowest: float, highest: float) -> Layout:
    """Return the layout of an uninterrupted record of noise.

    Parameters
    ----------
    samples : int
    lowest, highest : float
        Band, in Hz.

    Returns
    -------
    Layout
    """
    frequency = np.arange(BLOCK // 2 + 1) * (RATE / BLOCK)
    return Layout(
        samples=samples,
        sample_rate=RATE,
        block_samples=BLOCK,
        fade_samples=0,
        overlap=OVERLAP,
        periodic=False,
        delay_blocks=0,
        captures=(Capture(start=0, periods=samples // BLOCK, realisation=0, experiment=0),),
        lowest=lowest,
        highest=highest,
        excited=(frequency >= lowest) & (frequency <= highest),
        detection=np.zeros(frequency.size, dtype=bool),
        window=Window.HANN,
    )


def _peer(name: str, directory: Path, own_seconds: float) -> dict[str, object]:
    try:
        arrays = peer_arrays(name, "identification_peer.py", name, directory=directory)
    except PeerMissingError as error:
        return {"skipped": str(error)}
    seconds = float(arrays.pop("seconds"))
    return {
        "versions": list(PEERS[name]),
        "seconds": seconds,
        "times_faster": seconds / own_seconds,
        "largest_relative_difference": {method: _difference(method, frf) for method, frf in arrays.items()},
    }


def _difference(method: str, peer: np.ndarray) -> float:
    kind = EstimatorKind(method)
    local = kind in (EstimatorKind.LOCAL_POLYNOMIAL, EstimatorKind.LOCAL_RATIONAL)
    if kind is EstimatorKind.HV:
        drive, response = scaled_record()
    elif local:
        drive, response = resonant_record(seconds=LOCAL_SECONDS, noise=0.0)
    else:
        drive, response = resonant_record(seconds=COMPARED_SECONDS, noise=1e-3)
    layout = noise_layout(drive.shape[1], lowest=10.0, highest=60.0)
    own: FrfEstimate = estimate(kind, drive, response, layout, EstimatorOptions(half_width=HALF_WIDTH))
    theirs = peer if local else peer[own.valid]
    return float(np.max(np.abs(own.frf[own.valid] - theirs)) / np.max(np.abs(theirs)))


def _memory_growth(work: Callable[[], object]) -> float:
    """Return the largest growth of the process in MiB."""
    Path("/proc/self/clear_refs").write_text("5")  # the highest so far is forgotten
    before = resident_bytes("VmRSS")
    work()
    return (resident_bytes("VmHWM") - before) / 2**20


def _best(work: Callable[[], object]) -> float:
    return min(_timed(work) for _ in range(REPETITIONS))


def _timed_warm(work: Callable[[], object]) -> float:
    """Time a second run: the memory that the work before gave back is not charged to it, as it is not to the peers."""
    work()
    return _timed(work)


def _timed(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


if __name__ == "__main__":
    if "--own" in sys.argv:
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        sys.stdout.write(json.dumps(_own_figures()))
    else:
        sys.stdout.write(json.dumps(measure_identification(Path("out/peers")), indent=2) + "\n")
