"""Channels and sampled signals for lab scripts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, cast

import numpy as np

from duralab.arguments import real_numbers
from duralab.data.sensor import Sensor
from duralab.display import MOST_CHARTS, Axis, Curve, html_table, line_chart, text_table
from duralab.errors import InputError
from duralab_proto.arrays import from_record, to_record
from duralab_proto.v1 import array_pb2

if TYPE_CHECKING:
    from collections.abc import Iterable

    import xarray

_LARGEST_JITTER: Final = 1e-6
"""Largest error of a sample's time, as a share of the step: allows for times rounded to a few decimals."""

LARGEST_RATE_ERROR: Final = 1e-5
"""Largest relative error of a sample rate, as from a rounded time step: 36 ms after an hour."""

_SIGNALS: Final = ("channel", "unit", "smallest", "largest", "RMS")


@dataclass(frozen=True)
class Channel:
    """One drive or response channel; axes follow ISO 8855 (x forward, y left, z up).

    Parameters
    ----------
    name : str
        Name, unique within its rig and direction, e.g. "left_vertical".
    unit : str
        SI unit symbol.
    kind : int
        Value of `duralab.v1.ChannelKind`.
    minimum, maximum : float
        Allowed range, in `unit`.
    slew_limit : float
        Largest allowed magnitude of the time derivative, in `unit` per second; 0 if not stated.
    actuator_speed : float
        For a drive: speed of the actuator with its valve at its stop, in `unit` per second; 0 if not stated.
    label : str
        Description and point of action.
    watchdog : float
        For a response: magnitude at which the rig's watchdog ends a run, in `unit`; 0 if not stated.
    holds_static : bool
        For a drive: whether the rig states that it holds a constant value, as in displacement control.
    ac_coupled : bool
        For a response: whether the sensor does not measure a constant value.
    sensor : Sensor, optional
        For a response: the sensor, if the rig states it.
    calculated : tuple of (str, float)
        For a calculated channel: name and weight of each channel in its sum.
    """

    name: str
    unit: str
    kind: int = 0
    minimum: float = -np.inf
    maximum: float = np.inf
    slew_limit: float = 0.0
    actuator_speed: float = 0.0
    label: str = ""
    watchdog: float = 0.0
    holds_static: bool = False
    ac_coupled: bool = False
    sensor: Sensor | None = None
    calculated: tuple[tuple[str, float], ...] = ()

    @property
    def title(self) -> str:
        """Name with spaces, e.g. "left vertical"."""
        return self.name.replace("_", " ")

    @classmethod
    def from_message(cls, message: array_pb2.Channel) -> Channel:
        """Decode a channel."""
        return cls(
            name=message.name,
            unit=message.unit,
            kind=message.kind,
            minimum=message.minimum,
            maximum=message.maximum,
            slew_limit=message.slew_limit,
            actuator_speed=message.actuator_speed,
            label=message.label,
            watchdog=message.watchdog,
            holds_static=message.holds_static,
            ac_coupled=message.ac_coupled,
            sensor=Sensor.from_message(message.sensor) if message.HasField("sensor") else None,
            calculated=tuple((term.channel, term.weight) for term in message.calculated),
        )

    def to_message(self) -> array_pb2.Channel:
        """Encode the channel."""
        return array_pb2.Channel(
            name=self.name,
            unit=self.unit,
            kind=cast("array_pb2.ChannelKind", self.kind),
            minimum=self.minimum,
            maximum=self.maximum,
            slew_limit=self.slew_limit,
            actuator_speed=self.actuator_speed,
            label=self.label,
            watchdog=self.watchdog,
            holds_static=self.holds_static,
            ac_coupled=self.ac_coupled,
            sensor=None if self.sensor is None else self.sensor.to_message(),
            calculated=[array_pb2.CalculatedTerm(channel=name, weight=weight) for name, weight in self.calculated],
        )


@dataclass(frozen=True, eq=False)
class Signals:
    """Sampled signals of several channels.

    Parameters
    ----------
    channels : tuple of Channel
        Channels, one for each row of `samples`.
    sample_rate : float
        Samples per second, in hertz, greater than 0.
    samples : np.ndarray, shape (channels, samples)
        Samples as float64, each row in its channel's unit.
    attributes : mapping of str to str
        Other attributes from the file; see `duralab.formats`.
    """

    channels: tuple[Channel, ...]
    sample_rate: float
    samples: np.ndarray
    attributes: Mapping[str, str] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, in order."""
        return tuple(channel.name for channel in self.channels)

    @property
    def time(self) -> np.ndarray:
        """Time of each sample, in seconds from the first; shape (samples)."""
        return np.arange(self.samples.shape[1]) / self.sample_rate

    @property
    def duration(self) -> float:
        """Length, in seconds."""
        return self.samples.shape[1] / self.sample_rate

    @classmethod
    def from_message(cls, record: array_pb2.Record, *, field: str = "record") -> Signals:
        """Decode and check a record; the samples are a read-only view of the message's bytes."""
        channels, sample_rate, samples = from_record(record, field=field)
        return cls(tuple(Channel.from_message(channel) for channel in channels), sample_rate, samples)

    @classmethod
    def from_xarray(cls, labelled: xarray.DataArray | xarray.Dataset) -> Signals:
        """Convert labelled arrays, such as those of `to_xarray` and `Recording.drives`, to signals.

        Parameters
        ----------
        labelled : xarray.DataArray or xarray.Dataset
            Array with the dimensions `channel` and `time`.

        Returns
        -------
        Signals
            Signals in the units of the coordinate `unit`.

        Raises
        ------
        InputError
            The dimensions are not `channel` and `time`, or there is no sample rate.
        """
        return from_xarray(labelled)

    def to_message(self) -> array_pb2.Record:
        """Encode the signals."""
        return to_record([channel.to_message() for channel in self.channels], self.sample_rate, self.samples)

    def to_xarray(self, name: str = "signals") -> xarray.DataArray:
        """Return a labelled array with the dimensions `channel` and `time`, units in the coordinate `unit`.

        Parameters
        ----------
        name : str
            Name of the array.

        Returns
        -------
        xarray.DataArray
            Array with the coordinates `channel`, `time` and `unit`.
        """
        import xarray

        return xarray.DataArray(
            self.samples,
            dims=("channel", "time"),
            coords={
                "channel": list(self.names),
                "time": ("time", self.time, {"units": "s"}),
                "unit": ("channel", [channel.unit for channel in self.channels]),
            },
            name=name,
            attrs={"sample_rate": self.sample_rate},
        )

    def __repr__(self) -> str:
        """Return a one-line description without the samples."""
        names = ", ".join(self.names)
        return f"Signals({len(self.channels)} x {self.samples.shape[-1]} at {self.sample_rate:g} Hz: {names})"

    def __str__(self) -> str:
        """Return a table with smallest, largest and RMS value of every channel."""
        return signals_text(self)

    def _repr_html_(self) -> str:

        return signals_html(self)


def channels_of(messages: Iterable[array_pb2.Channel]) -> tuple[Channel, ...]:
    """Decode channels, in order.

    `messages`: The channels as messages.
    Returns: The channels, in the same order.
    """
    return tuple(Channel.from_message(message) for message in messages)


def from_xarray(labelled: xarray.DataArray | xarray.Dataset) -> Signals:
    """Return labelled arrays as signals."""
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
    # A rate of 500 Hz must not become 499.9999999999: the rig plays exactly one rate.
    return float(np.round(1.0 / step, 6))


def _signals_rows(signals: Signals) -> list[tuple[str, ...]]:
    return [
        (channel.name, channel.unit, *(f"{value:.4g}" for value in (row.min(), row.max(), np.sqrt(np.mean(row**2)))))
        if row.size
        else (channel.name, channel.unit, "–", "–", "–")
        for channel, row in zip(signals.channels, signals.samples, strict=True)
    ]


def _signals_title(signals: Signals) -> str:
    return f"{signals.samples.shape[-1]} samples at {signals.sample_rate:g} Hz, {signals.duration:g} s"


def signals_text(signals: Signals) -> str:
    """Return smallest, largest and RMS value of each channel as text."""
    return f"{_signals_title(signals)}\n{text_table(_SIGNALS, _signals_rows(signals), left=2)}"


def signals_html(signals: Signals) -> str:
    """Return the same as HTML, with the waveforms."""
    table = html_table(_SIGNALS, _signals_rows(signals), left=2, caption=_signals_title(signals))
    return table + "".join(waveforms(signals))


def waveforms(*signals: Signals, names: Sequence[str] = ("",)) -> list[str]:
    """Return a chart for each channel; signals with the same channels share the charts."""
    first = signals[0]
    charts = [
        line_chart(
            [Curve(name, each.time, each.samples[row]) for name, each in zip(names, signals, strict=True)],
            x=Axis("time [s]"),
            y=Axis(f"[{channel.unit or '–'}]"),
            title=channel.title,
            height=150,
        )
        for row, channel in enumerate(first.channels[:MOST_CHARTS])
    ]
    if (more := len(first.channels) - MOST_CHARTS) > 0:
        charts.append(f"<p>and {more} channels more, not drawn</p>")
    return charts
