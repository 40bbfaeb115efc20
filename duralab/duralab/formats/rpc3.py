"""RPC III time histories as signals; the codec is that of `duralab_drive_files`."""

from __future__ import annotations

from pathlib import Path

import duralab_drive_files
from duralab.data import Channel, Signals
from duralab.formats.errors import Written, as_input_error
from duralab_drive_files import Rpc3Settings, TimeHistory


@as_input_error()
def read_rpc3(path: Path) -> Signals:
    """Read an RPC III time history."""
    file = duralab_drive_files.read_rpc3(path)
    channels = tuple(
        Channel(name=name, unit=unit, label=label)
        for name, unit, label in zip(file.names, file.units, file.labels, strict=True)
    )
    return Signals(channels, file.sample_rate, file.samples, file.attributes)


@as_input_error()
def write_rpc3(signals: Signals, path: Path, settings: Rpc3Settings | None = None) -> Written:
    """Write an RPC III time history."""
    units = tuple(channel.unit for channel in signals.channels)
    history = TimeHistory(signals.names, units, signals.sample_rate, signals.samples, signals.attributes)
    written = duralab_drive_files.write_rpc3(history, path, settings)
    notes = (f"{written.padding} zeros pad the last group; SAMPLES keeps the length.",) if written.padding else ()
    return Written(path, "rpc3", signals.samples.shape[1], written.padding, written.largest_errors, notes)
