"""A drive as a script gives it, checked against the rig that shall play it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from duralab.errors import InputError
from duralab.rig import Rig
from duralab.signals import Signals
from duralab_proto.arrays import ArrayError

if TYPE_CHECKING:
    import xarray


def drive_signals(drive: np.ndarray | xarray.DataArray | Signals, rig: Rig) -> Signals:
    """Return the drive with the rig's channels and sample rate.

    Parameters
    ----------
    drive : array or Signals, shape (drives, samples)
        In the units and the order of the rig's description.
    rig : Rig
        That shall play it.

    Returns
    -------
    Signals
        The same.

    Raises
    ------
    InputError
        The shape does not fit, or a value is not finite.
    """
    if isinstance(drive, Signals):
        return drive
    samples = np.ascontiguousarray(drive, dtype=np.float64)
    if samples.ndim != 2 or samples.shape[0] != len(rig.drives):
        names = ", ".join(channel.name for channel in rig.drives)
        raise InputError(
            f"The drive has the shape {samples.shape}; rig {rig.name!r} needs ({len(rig.drives)}, samples): {names}.",
            field="drive.samples",
        )
    signals = Signals(rig.drives, rig.sample_rate, samples)
    try:
        signals.to_message()
    except ArrayError as error:
        raise InputError(str(error), field=error.field) from error
    return signals
