"""TDMS measurements by npTDMS."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from duralab.data import Channel, Signals
from duralab.formats.columns import rate_of_step, require_finite, unique_names
from duralab.formats.errors import FormatError, require_file
from duralab.formats.libraries import parsing, require_library
from duralab.formats.written import Written

STEP: Final = "wf_increment"
UNIT: Final = "unit_string"
GROUP: Final = "signals"
_EXPECTED: Final = "a TDMS measurement"


def read_tdms(path: Path) -> Signals:
    """Read a TDMS measurement."""
    nptdms = require_library("nptdms", extra="tdms")
    size = require_file(path)
    with parsing(path, _EXPECTED) as stream, nptdms.TdmsFile.open(stream) as file:
        found = [
            channel
            for group in file.groups()
            for channel in group.channels()
            if channel.data_type is not None and np.dtype(channel.dtype).kind in "iuf"
        ]
        steps = {(float(channel.properties.get(STEP, np.nan)), len(channel)) for channel in found}
        if len(steps) != 1:
            raise FormatError(
                path,
                f"{len(found)} channels of numbers have the steps and lengths {sorted(steps)[:4]}; one {STEP} in "
                "seconds and one length for all were expected.",
            )
        ((step, length),) = steps
        if not (0 < step < np.inf and np.isfinite(1 / step) and length):
            raise FormatError(path, f"{STEP} is {step} s with {length} samples; both must be greater than 0.")
        announced = sum(length * np.dtype(channel.dtype).itemsize for channel in found)
        if announced > size:
            raise FormatError(
                path, f"its channels announce {announced} bytes of samples; the file ends here.", offset=size
            )
        units = [str(channel.properties.get(UNIT, "")) for channel in found]
        names = unique_names(channel.name for channel in found)
        samples = np.array([channel[:] for channel in found], dtype=np.float64)
        attributes = {str(key): str(value) for key, value in file.properties.items()}
    require_finite(path, names, samples)
    channels = tuple(Channel(name, unit) for name, unit in zip(names, units, strict=True))
    return Signals(channels, rate_of_step(step, resolution=1e-9 * step), samples, attributes)


def write_tdms(signals: Signals, path: Path) -> Written:
    """Write a TDMS measurement of float64, one group; attributes become properties of the file."""
    nptdms = require_library("nptdms", extra="tdms")
    objects = [nptdms.RootObject(properties=dict(signals.attributes)), nptdms.GroupObject(GROUP)]
    for channel, row in zip(signals.channels, signals.samples, strict=True):
        properties = {STEP: 1 / signals.sample_rate, "wf_samples": 1, "wf_start_offset": 0.0, UNIT: channel.unit}
        objects.append(nptdms.ChannelObject(GROUP, channel.name, row, properties=properties))
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(objects)
    return Written(path, "tdms", signals.samples.shape[1], 0, (0.0,) * len(signals.channels))
