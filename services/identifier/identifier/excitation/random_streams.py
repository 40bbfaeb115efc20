"""One independent stream of random numbers for every purpose, drive and realisation of an experiment."""

from enum import IntEnum

import numpy as np


class Purpose(IntEnum):
    """Purpose of a random stream: the first number of its key.

    Pure random, which draws nothing else, has the drive's number instead.
    """

    DRIVE_PHASES = 1
    EXPERIMENT_PHASES = 2
    DETECTION_LINES = 3
    BURST = 4


def random_stream(seed: int, *key: int) -> np.random.Generator:
    """Make the stream of a key."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
