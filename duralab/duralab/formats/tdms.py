"""TDMS measurements by npTDMS."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from duralab.data import Signals
from duralab.formats.columns import left_out, one_step, require_one_time, signals_read
from duralab.formats.errors import FormatError, Written, require_file
from duralab.formats.libraries import parsing, require_library
from duralab_drive_files import rate_of_step

STEP: Final = "wf_increment"
START: Final = "wf_start_offset"
X_UNIT: Final = "wf_xunit_string"
UNIT: Final = "unit_string"
GROUP: Final = "signals"
_EXPECTED: Final = "a TDMS measurement"


def read_tdms(path: Path) -> Signals:
    """Read a TDMS measurement."""
    nptdms = require_library("nptdms", extra="tdms")
    _silence()
    size = require_file(path)
    with parsing(path, _EXPECTED) as stream, nptdms.TdmsFile.open(stream) as file:
        channels = [channel for group in file.groups() for channel in group.channels() if channel.data_type is not None]
        found = [channel for channel in channels if np.dtype(channel.dtype).kind in "iuf"]
        announced = sum(len(channel) * np.dtype(channel.dtype).itemsize for channel in found)
        if file.file_status.incomplete_final_segment or announced > size:
            raise FormatError(path, "the file ends before its last sample; copy or save it again.", offset=size)
        steps = [(float(channel.properties.get(STEP, np.nan)), len(channel)) for channel in found]
        step = one_step(path, f"{len(found)} channels of numbers", steps, step_name=STEP)
        require_one_time(
            path, [(channel.name, str(channel.properties.get(X_UNIT, "")), _start(channel)) for channel in found]
        )
        units = [str(channel.properties.get(UNIT, "")) for channel in found]
        names = [channel.name for channel in found]
        samples = np.array([channel[:] for channel in found], dtype=np.float64)
        attributes = {str(key): str(value) for key, value in file.properties.items()}
        attributes |= left_out([channel.name for channel in channels if channel not in found])
    rate = rate_of_step(step, resolution=1e-9 * step)
    return signals_read(path, names, units, samples, sample_rate=rate, attributes=attributes)


def _start(channel: Any) -> str:
    """Return the start of a channel: seconds, after a point in time if the file has one."""
    seconds, after = float(channel.properties.get(START, 0.0)), channel.properties.get("wf_start_time")
    return f"{seconds} s" if after is None else f"{seconds} s after {after}"


def _silence() -> None:
    """Remove npTDMS's handler that writes warnings about damaged files to standard error."""
    from nptdms.log import log_manager

    for logger in log_manager.loggers.values():
        logger.removeHandler(log_manager.console_handler)


def write_tdms(signals: Signals, path: Path) -> Written:
    """Write a TDMS measurement of float64, one group; attributes become properties of the file."""
    nptdms = require_library("nptdms", extra="tdms")
    objects = [nptdms.RootObject(properties=dict(signals.attributes)), nptdms.GroupObject(GROUP)]
    for channel, row in zip(signals.channels, signals.samples, strict=True):
        properties = {STEP: 1 / signals.sample_rate, "wf_samples": 1, START: 0.0, UNIT: channel.unit}
        objects.append(nptdms.ChannelObject(GROUP, channel.name, row, properties=properties))
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(objects)
    return Written(path, "tdms", signals.samples.shape[1], 0, (0.0,) * len(signals.channels))
