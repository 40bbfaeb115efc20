"""Reduction of the points of the live view; every peak is kept. The log keeps every sample."""

from __future__ import annotations

import numpy as np

BUCKETS_PER_PERIOD = 3
"""Number of buckets in the shortest period of interest, each drawn with its two extremes: six points a period."""


def bucket_samples(sample_rate: float, highest_frequency: float) -> int:
    """Return the number of samples that share two points; 2, which keeps all samples, if none can be left out."""
    if highest_frequency <= 0:
        return 2
    return max(2, int(sample_rate / (BUCKETS_PER_PERIOD * highest_frequency)))


def keep_extremes(samples: np.ndarray, bucket: int) -> np.ndarray:
    """Return the indices of the drawn samples: the smallest and the largest of each bucket."""
    count = samples.size
    if bucket <= 2 or count <= bucket:
        return np.arange(count)
    whole = count // bucket * bucket
    table = samples[:whole].reshape(-1, bucket)
    starts = np.arange(0, whole, bucket)
    pairs = np.sort(np.column_stack([starts + table.argmin(axis=1), starts + table.argmax(axis=1)]), axis=1)
    rest = samples[whole:]
    left = np.sort([whole + rest.argmin(), whole + rest.argmax()]) if rest.size else starts[:0]
    # Already ascending: only neighbours can be equal.
    indices = np.concatenate([starts[:1], pairs.ravel(), left, np.array([count - 1])])
    return indices[np.diff(indices, prepend=-1) > 0]
