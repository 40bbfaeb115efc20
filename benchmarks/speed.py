"""Speed and accuracy of a loaded rig."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from rig_sim import Engine, EngineChoice, PlayableRig, Rig, load_rig

#: Number of playbacks; the fastest counts, because other load can only make a playback slower.
REPETITIONS = 5
REFERENCE_FACTOR = 8


def play(rig: PlayableRig, drive: np.ndarray) -> float:
    """Return the wall time of a playback of a drive (drives, samples), in s.

    Parameters
    ----------
    rig : PlayableRig
    drive : ndarray, (drives, samples)
        Each channel in its unit.

    Returns
    -------
    float
    """
    start = time.perf_counter()
    for _ in rig.playback(drive, seed=1).blocks():
        pass
    return time.perf_counter() - start


def real_time_factor(rig: PlayableRig, drive: np.ndarray) -> float:
    """Return simulated seconds per wall second on one core, of the fastest of five playbacks.

    Parameters
    ----------
    rig : PlayableRig
    drive : ndarray, (drives, samples)

    Returns
    -------
    float
    """
    seconds = drive.shape[1] / rig.specimen.sample_rate
    return seconds / min(play(rig, drive) for _ in range(REPETITIONS))


def real_time_factor_of_two(rig: PlayableRig, drive: np.ndarray) -> float:
    """Return the simulated seconds of two rigs on two threads, added, per wall second, of the fastest of five.

    Parameters
    ----------
    rig : PlayableRig
    drive : ndarray, (drives, samples)

    Returns
    -------
    float
    """
    seconds = 2.0 * drive.shape[1] / rig.specimen.sample_rate
    walls = []
    with ThreadPoolExecutor(2) as pool:
        for _ in range(REPETITIONS):
            start = time.perf_counter()
            list(pool.map(lambda _: play(rig, drive), range(2)))
            walls.append(time.perf_counter() - start)
    return seconds / min(walls)


def relative_error(rig: PlayableRig, drive: np.ndarray) -> float | None:
    """Return the worst response's RMS error over its RMS about the rest, against steps eight times shorter.

    Parameters
    ----------
    rig : PlayableRig
    drive : ndarray, (drives, samples)

    Returns
    -------
    float or None
        None where nothing is integrated: a structure is played in closed form.
    """
    if not isinstance(rig, Rig):
        return None
    # A rig that wears has inputs for what its parts have lost: nothing, while it is new.
    as_new = np.zeros((len(rig.model.input_names) - len(drive), drive.shape[1]))
    coarse, fine = (
        rig.compiled.play(
            rig.rest,
            np.vstack([drive, as_new]),
            sample_interval=1.0 / rig.specimen.sample_rate,
            substeps=factor * rig.specimen.substeps,
            method=rig.specimen.integrator,
        ).outputs[: len(rig.specimen.responses)]
        for factor in (1, REFERENCE_FACTOR)
    )
    motion = np.sqrt(np.mean((fine - rig.static_response[:, None]) ** 2, axis=1))
    return float(np.max(np.sqrt(np.mean((coarse - fine) ** 2, axis=1)) / motion))


def drake_real_time_factor(path: Path, drive: np.ndarray) -> float:
    """Return the same for Drake's engine with its default accuracy, on a short drive.

    Parameters
    ----------
    path : Path
        The specimen's YAML.
    drive : ndarray, (drives, samples)

    Returns
    -------
    float
    """
    rig = load_rig(path, EngineChoice(engine=Engine.DRAKE))
    return drive.shape[1] / rig.specimen.sample_rate / play(rig, drive)
