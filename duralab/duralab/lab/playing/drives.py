"""A drive as a script gives it, checked against the rig that shall play it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from duralab.arguments import real_numbers
from duralab.data import Channel, Rig, Signals
from duralab.errors import InputError
from duralab_proto.arrays import ArrayError

if TYPE_CHECKING:
    import numpy as np
    import xarray


def drive_signals(drive: np.ndarray | xarray.DataArray | xarray.Dataset | Signals, rig: Rig) -> Signals:
    """Return the drive with the rig's channels, in its order."""
    if isinstance(drive, Signals):
        return _checked(_in_order(drive, rig))
    # Not an import of xarray for who has none: only a dataset, or an array with names, is told by name.
    if hasattr(drive, "data_vars") or "channel" in getattr(drive, "coords", ()):
        return _checked(_in_order(Signals.from_xarray(drive), rig))  # type: ignore[arg-type]
    samples = _real(drive)
    if samples.ndim != 2 or samples.shape[0] != len(rig.drives):
        names = ", ".join(channel.name for channel in rig.drives)
        raise InputError(
            f"The drive has the shape {samples.shape}; rig {rig.name!r} needs ({len(rig.drives)}, samples): {names}.",
            field="drive.samples",
        )
    return _checked(Signals(rig.drives, rig.sample_rate, samples))


def _real(samples: np.ndarray | xarray.DataArray | xarray.Dataset) -> np.ndarray:
    return real_numbers(samples, what="The drive", field="drive.samples")


def _in_order(signals: Signals, rig: Rig) -> Signals:
    wanted = [channel.name for channel in rig.drives]
    if sorted(signals.names) != sorted(wanted) or len(signals.samples) != len(wanted):
        return signals
    rows = [signals.names.index(name) for name in wanted]
    given = [signals.channels[row].unit.strip() for row in rows]
    silent = [drive for unit, drive in zip(given, rig.drives, strict=True) if drive.unit and not unit]
    if silent:
        raise InputError(
            f"The drive names no unit for {', '.join(drive.name for drive in silent)}; rig {rig.name!r} takes "
            f"{', '.join(dict.fromkeys(drive.unit for drive in silent))}, so name what the values are in, or give a "
            "plain array in the rig's units.",
            field="drive.unit",
        )
    channels = tuple(_described(signals.channels[row], drive) for row, drive in zip(rows, rig.drives, strict=True))
    return replace(signals, channels=channels, samples=_real(signals.samples)[rows])


def _described(channel: Channel, drive: Channel) -> Channel:
    """Return the rig's own words for a channel, unless it is in another unit: the rig refuses that."""
    return drive if channel.unit == drive.unit else channel


def _checked(signals: Signals) -> Signals:
    try:
        signals.to_message()
    except ArrayError as error:
        raise InputError(str(error), field=error.field) from error
    return signals
