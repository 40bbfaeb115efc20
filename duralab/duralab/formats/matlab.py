"""MATLAB files of level 5 (`.mat`): samples, sample_rate, names and units."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from duralab.data import Signals
from duralab.errors import InputError
from duralab.formats.columns import signals_read
from duralab.formats.errors import FormatError, Written, require_file
from duralab.formats.libraries import parsing, require_room

VARIABLES: Final = ("samples", "sample_rate", "names", "units")
LARGEST_VARIABLE: Final = (1 << 31) - 1
"""Largest size of a variable in bytes; level 5 stores it in 32 bits."""

_EXPECTED: Final = (
    "a MATLAB file of level 5 (save -v7) with samples (channels × samples), sample_rate in Hz, and names and units as "
    "cell arrays"
)


def read_mat(path: Path) -> Signals:
    """Read a MATLAB file with the variables samples, sample_rate, names and units."""
    import scipy.io

    require_file(path)
    with parsing(path, _EXPECTED) as stream:
        shapes = {name: shape for name, shape, _ in scipy.io.whosmat(stream)}
        missing = [name for name in VARIABLES if name not in shapes]
        if missing:
            there = ", ".join(shapes) or "none"
            raise FormatError(path, f"it lacks {', '.join(missing)}; {_EXPECTED} was expected, and it has {there}.")
        require_room(path, max(math.prod(int(size) for size in shapes[name]) for name in VARIABLES))
        stream.seek(0)
        content = scipy.io.loadmat(stream, variable_names=VARIABLES, squeeze_me=False)
        stored = np.asarray(content["samples"])
        rate = np.asarray(content["sample_rate"], dtype=np.float64)
        names, units = (
            [str(np.asarray(cell).item()) if np.asarray(cell).size else "" for cell in content[variable].ravel()]
            for variable in ("names", "units")
        )
    if stored.ndim != 2 or stored.dtype.kind not in "iuf" or not len(names) == len(units) == stored.shape[0]:
        raise FormatError(
            path,
            f"samples is {stored.dtype} of shape {stored.shape}, with {len(names)} names and {len(units)} units; "
            f"{_EXPECTED} was expected.",
        )
    if rate.size != 1 or not (0 < rate.item() < math.inf):
        raise FormatError(path, f"sample_rate is {rate.ravel()[:3]}; one number greater than 0 was expected.")
    return signals_read(path, names, units, stored, sample_rate=float(rate.item()))


def write_mat(signals: Signals, path: Path) -> Written:
    """Write a MATLAB file of level 5, compressed."""
    import scipy.io

    if signals.samples.nbytes > LARGEST_VARIABLE:
        raise InputError(
            f"The samples take {signals.samples.nbytes} bytes; a MATLAB file of level 5 holds {LARGEST_VARIABLE} at "
            "most. Cut them, or write MDF 4."
        )
    with path.open("wb") as stream:
        scipy.io.savemat(
            stream,
            {
                "samples": signals.samples,
                "sample_rate": float(signals.sample_rate),
                "names": np.array(signals.names, dtype=object),
                "units": np.array([channel.unit for channel in signals.channels], dtype=object),
            },
            do_compression=True,
        )
    notes = ("The MATLAB file keeps no attributes.",) if signals.attributes else ()
    return Written(path, "mat", signals.samples.shape[1], 0, (0.0,) * len(signals.channels), notes)
