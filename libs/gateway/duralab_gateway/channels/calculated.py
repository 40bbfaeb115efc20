"""Calculated channels: sums, differences and weighted sums of measured ones, with units checked by pint."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Final, Self

import numpy as np
from pydantic import Field, model_validator

from duralab_proto.channels import UNIT_OF_KIND
from duralab_proto.v1 import array_pb2
from duralab_settings import Positive, Section, SettingsError, UnitError, unit_conversion

_WEIGHT: Final = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?:\s+(\S.*?))?\s*")


class Kind(StrEnum):
    """Kind of a channel, as written in a configuration."""

    DISPLACEMENT = "displacement"
    FORCE = "force"
    MOMENT = "moment"
    ACCELERATION = "acceleration"
    PRESSURE = "pressure"
    RATIO = "ratio"
    VELOCITY = "velocity"
    STRAIN = "strain"
    ANGLE = "angle"
    VOLTAGE = "voltage"
    CURRENT = "current"


Name = Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$", max_length=120)]


class CalculatedChannel(Section):
    """Channel that is calculated from measured ones, sample by sample.

    Raises
    ------
    SettingsError
        Not exactly one of `sum`, `difference` and `weights` is given, or a weight is not a number and a unit.
    """

    name: Name = Field(description="Name of the calculated channel, lower_snake_case.")
    kind: Kind = Field(strict=False, description="What it is, such as force or moment; decides its unit.")
    sum: tuple[str, ...] | None = Field(default=None, strict=False, min_length=1, description="Channels to add.")
    difference: tuple[str, str] | None = Field(
        default=None, strict=False, description="Two channels: the first less the second."
    )
    weights: dict[str, float | str] | None = Field(
        default=None, min_length=1, description="Weight of each channel: a number, or one with a unit, e.g. 0.75 m."
    )
    label: str = Field(default="", description="What it is and where it acts.")
    warning_level: Positive | None = Field(default=None, description="Magnitude that is reported as a warning.")
    abort_level: Positive | None = Field(default=None, description="Magnitude that stops and latches the rig.")

    @model_validator(mode="after")
    def _check_terms(self) -> Self:
        given = [key for key in ("sum", "difference", "weights") if getattr(self, key) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none"
            raise ValueError(f"{self.name} has {found} of sum, difference and weights; give exactly one")
        names = [*(self.sum or ()), *(self.difference or ())]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"{self.name} names {twice[0]} twice; use weights")
        for name, (weight, _) in self._weights().items():
            if not (np.isfinite(weight) and weight):
                raise ValueError(f"{self.name} weighs {name} by {weight:g}; leave it out, or give another weight")
        return self

    @property
    def unit(self) -> str:
        """SI unit of its kind."""
        return UNIT_OF_KIND[self.kind_number]

    @property
    def kind_number(self) -> array_pb2.ChannelKind:
        """Number of its kind in the contract."""
        return getattr(array_pb2, f"CHANNEL_KIND_{self.kind.name}")

    def _weights(self) -> dict[str, tuple[float, str]]:
        """Return the weight and its unit by channel."""
        if self.sum is not None:
            return dict.fromkeys(self.sum, (1.0, "1"))
        if self.difference is not None:
            return dict(zip(self.difference, ((1.0, "1"), (-1.0, "1")), strict=True))
        weights = {}
        for name, text in (self.weights or {}).items():
            match = _WEIGHT.fullmatch(str(text))
            if match is None:
                raise ValueError(f"{self.name} weighs {name} by {text!r}; give a number, or one and a unit: 0.75 m")
            weights[name] = float(match[1]), match[2] or "1"
        return weights

    def factors(self, units: Mapping[str, str]) -> dict[str, float]:
        """Return the factor of each measured channel, from its unit to that of the calculated channel.

        Parameters
        ----------
        units : mapping of str to str
            Unit of each measured channel, by name.

        Returns
        -------
        dict of str to float
            Factors of the channels in the calculation only.

        Raises
        ------
        SettingsError
            A channel does not exist, or its unit times that of the weight does not convert; one sentence.
        """
        if unknown := [name for name in self._weights() if name not in units]:
            raise SettingsError(
                f"{self.name} is calculated from {', '.join(unknown)}; there are {', '.join(units)}.", field=self.name
            )
        factors = {}
        for name, (weight, unit) in self._weights().items():
            try:
                factor, offset = unit_conversion(units[name], self.unit, name, times=unit)
            except UnitError as error:
                raise SettingsError(
                    f"{self.name} is a {self.kind} in {self.unit!r}: {str(error).rstrip('.')}; give its weight a "
                    "unit, such as 0.75 m.",
                    field=self.name,
                ) from error
            if offset:
                raise SettingsError(
                    f"{self.name} adds {name} in {units[name]!r}, whose zero is not that of {self.unit!r}; convert it "
                    "first.",
                    field=self.name,
                )
            factors[name] = weight * factor
        return factors

    def describe(self, channels: Mapping[str, array_pb2.Channel]) -> array_pb2.Channel:
        """Return its description among measured channels; its range follows from theirs.

        Parameters
        ----------
        channels : mapping of str to array_pb2.Channel
            Measured channels by name.

        Returns
        -------
        array_pb2.Channel
            Description with its terms and levels.

        Raises
        ------
        SettingsError
            As for `factors`.
        """
        factors = self.factors({name: channel.unit for name, channel in channels.items()})
        ends = [(factor * channels[name].minimum, factor * channels[name].maximum) for name, factor in factors.items()]
        described = array_pb2.Channel(
            name=self.name,
            unit=self.unit,
            kind=self.kind_number,
            minimum=sum(map(min, ends)),
            maximum=sum(map(max, ends)),
            label=self.label,
            ac_coupled=any(channels[name].ac_coupled for name in factors),
            calculated=[array_pb2.CalculatedTerm(channel=name, weight=factor) for name, factor in factors.items()],
        )
        if self.warning_level or self.abort_level:
            described.sensor.warning_level = self.warning_level or 0.0
            described.sensor.abort_level = self.abort_level or 0.0
        return described


def weighted_sum(factors: Mapping[int, float], samples: np.ndarray) -> np.ndarray:
    """Return one row: the sum of weighted rows, with the same bytes for any division of the record into blocks.

    Parameters
    ----------
    factors : mapping of int to float
        Factor of each row, by row.
    samples : np.ndarray, shape (channels, ...)
        Measured channels, each in its unit.

    Returns
    -------
    np.ndarray
        Weighted sum, of the shape of one row, in the unit of the calculated channel.
    """
    # Not a matrix product: the order of its sums depends on the length.
    total = np.zeros(samples.shape[1:], dtype=samples.dtype)
    for row, factor in factors.items():
        total = total + factor * samples[row]
    return total
