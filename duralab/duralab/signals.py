"""Channels and sampled signals as a lab script meets them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import numpy as np

from duralab_proto.arrays import from_record, to_record
from duralab_proto.v1 import array_pb2

if TYPE_CHECKING:
    from collections.abc import Iterable

    import xarray


@dataclass(frozen=True)
class Channel:
    """One drive or response channel; axes follow ISO 8855 (x forward, y left, z up).

    Parameters
    ----------
    name : str
        Unique within its rig and direction, e.g. "left_vertical".
    unit : str
        SI unit symbol.
    kind : int
        Value of `duralab.v1.ChannelKind`.
    minimum, maximum : float
        Allowed range, in `unit`.
    slew_limit : float
        Largest allowed magnitude of the time derivative, in `unit` per second; 0 where none is stated.
    label : str
        What it is and where it acts.
    watchdog : float
        Of a response: magnitude at which the rig's watchdog ends a run, in `unit`; 0 where none is stated.
    """

    name: str
    unit: str
    kind: int = 0
    minimum: float = -np.inf
    maximum: float = np.inf
    slew_limit: float = 0.0
    label: str = ""
    watchdog: float = 0.0

    @property
    def title(self) -> str:
        """The name as words, e.g. "left vertical"."""
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
            label=message.label,
            watchdog=message.watchdog,
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
            label=self.label,
            watchdog=self.watchdog,
        )


@dataclass(frozen=True, eq=False)
class Signals:
    """Sampled signals of several channels.

    Parameters
    ----------
    channels : tuple of Channel
        One for each row of `samples`.
    sample_rate : float
        Samples per second, in hertz, greater than 0.
    samples : np.ndarray, shape (channels, samples)
        float64, each row in its channel's unit.
    attributes : mapping of str to str
        What else the file they were read from says of them; see `duralab.formats`.
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
        """Return labelled arrays as signals, such as `to_xarray` and `Recording.drives` give.

        Parameters
        ----------
        labelled : xarray.DataArray or xarray.Dataset
            With the dimensions `channel` and `time`.

        Returns
        -------
        Signals
            In the units of the coordinate `unit`.

        Raises
        ------
        InputError
            Other dimensions than `channel` and `time`, or no sample rate.
        """
        from duralab._labelled_signals import from_xarray

        return from_xarray(labelled)

    def to_message(self) -> array_pb2.Record:
        """Encode the signals."""
        return to_record([channel.to_message() for channel in self.channels], self.sample_rate, self.samples)

    def to_xarray(self, name: str = "signals") -> xarray.DataArray:
        """Return a labelled array with the dimensions `channel` and `time`, units in the coordinate `unit`.

        Parameters
        ----------
        name : str
            Of the array.

        Returns
        -------
        xarray.DataArray
            With the coordinates `channel`, `time` and `unit`.
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
        """Return what they are on one line, without the samples."""
        names = ", ".join(self.names)
        return f"Signals({len(self.channels)} x {self.samples.shape[-1]} at {self.sample_rate:g} Hz: {names})"

    def __str__(self) -> str:
        """Return a table with smallest, largest and RMS value of every channel."""
        from duralab.showing.values import signals_text

        return signals_text(self)

    def _repr_html_(self) -> str:
        from duralab.showing.values import signals_html

        return signals_html(self)


def channels_of(messages: Iterable[array_pb2.Channel]) -> tuple[Channel, ...]:
    """Decode channels, in order."""
    return tuple(Channel.from_message(message) for message in messages)
