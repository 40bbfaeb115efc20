"""Signals out of xarray: channels by name, units and sample rate where they are told."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from duralab._real_numbers import real_numbers
from duralab.errors import InputError
from duralab.signals import Channel, Signals

if TYPE_CHECKING:
    import xarray

_LARGEST_JITTER: Final = 1e-6
"""Of a sample's time, as a share of the time between two: what numbers with a few decimals lose, and not more."""


def from_xarray(labelled: xarray.DataArray | xarray.Dataset) -> Signals:
    """Return labelled arrays as signals.

    Parameters
    ----------
    labelled : DataArray or Dataset
        An array over `channel` and `time`, with units in a coordinate `unit` where there is one; or a dataset with a
        variable for each channel over `time`, with its unit in the attribute `units`. As `Signals.to_xarray` and
        `Recording.drives` give them, in any order of dimensions.

    Returns
    -------
    Signals
        float64; the rate is the attribute `sample_rate`, or comes from the coordinate `time`.

    Raises
    ------
    InputError
        Other dimensions, no names, values that are not real, or neither rate nor an even time.
    """
    import xarray

    if isinstance(labelled, xarray.Dataset):
        arrays = {str(name): variable for name, variable in labelled.data_vars.items()}
        for name, variable in arrays.items():
            _require_dimensions(variable, ("time",), what=f"The variable {name!r}")
        channels = tuple(Channel(name, str(variable.attrs.get("units", ""))) for name, variable in arrays.items())
        rows = [
            real_numbers(variable.values, what=f"The variable {name!r}", field="drive.samples")
            for name, variable in arrays.items()
        ]
        if not rows:
            raise InputError("The dataset has no variable; one for each channel over `time` is needed.", field="drive")
        return Signals(channels, _sample_rate(labelled), np.stack(rows))
    _require_dimensions(labelled, ("channel", "time"), what="The array")
    if "channel" not in labelled.coords:
        raise InputError("The array has no names in a coordinate `channel`.", field="drive")
    names = [str(name) for name in labelled.coords["channel"].values]
    units = labelled.coords["unit"].values if "unit" in labelled.coords else [""] * len(names)
    samples = real_numbers(labelled.transpose("channel", "time").values, what="The array", field="drive.samples")
    channels = tuple(Channel(name, str(unit)) for name, unit in zip(names, units, strict=True))
    return Signals(channels, _sample_rate(labelled), samples)


def _require_dimensions(array: xarray.DataArray, wanted: tuple[str, ...], *, what: str) -> None:
    if set(array.dims) != set(wanted):
        there = ", ".join(str(name) for name in array.dims) or "none"
        raise InputError(f"{what} has the dimensions {there}; needed are {', '.join(wanted)}.", field="drive")


def _sample_rate(labelled: xarray.DataArray | xarray.Dataset) -> float:
    if "sample_rate" in labelled.attrs:
        return float(labelled.attrs["sample_rate"])
    time = np.asarray(labelled.coords["time"].values, dtype=np.float64) if "time" in labelled.coords else np.zeros(0)
    if time.size < 2:
        raise InputError(
            "The sample rate is not told; give it as the attribute `sample_rate` in hertz, or a coordinate `time` in "
            "seconds.",
            field="drive.sample_rate",
        )
    step = (time[-1] - time[0]) / (time.size - 1)
    uneven = np.abs(time - time[0] - step * np.arange(time.size)).max()
    if not (step > 0.0 and uneven <= _LARGEST_JITTER * step * time.size):
        raise InputError(
            f"The coordinate `time` is not even: samples lie up to {uneven:g} s off a step of {step:g} s; resample "
            "the signals first.",
            field="drive.sample_rate",
        )
    # A rate of 500 Hz must not become 499.9999999999: the rig plays exactly one.
    return float(np.round(1.0 / step, 6))
