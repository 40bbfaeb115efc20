"""A playback block by block, whatever moves: approach, drive, and the way back to rest."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field


class Approach(BaseModel):
    """Times of a rig's way to a drive's first sample and back; a slew limit makes a ramp longer."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    #: From rest to the first sample, in s; 0 for a rig that may begin with a step.
    ramp: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    #: How long the first sample is held before the drive begins, in s.
    settle: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    #: From where a playback is left to zero, in s, and how long zero is held then. Whoever stops a rig waits for both.
    ramp_down: Annotated[float, Field(gt=0.0, le=10.0)] = 0.5
    hold: Annotated[float, Field(ge=0.0, le=10.0)] = 0.1


class DriveChannel(Protocol):
    """A drive channel: its name and limits, as far as a playback needs them."""

    @property
    def name(self) -> str:
        """Name of the channel."""
        ...

    @property
    def minimum(self) -> float:
        """Lower limit, in the channel's unit."""
        ...

    @property
    def maximum(self) -> float:
        """Upper limit, in the channel's unit."""
        ...

    @property
    def slew_limit(self) -> float:
        """Largest rate, in unit per second; 0 where none is stated."""
        ...


def lead_in(approach: Approach, first: np.ndarray, channels: Sequence[DriveChannel], sample_rate: float) -> np.ndarray:
    """Return the commands from rest to a drive's first sample, which is their last column.

    No samples where that is zero, or where the rig begins with a step.
    """
    if approach.ramp == 0.0 or not first.any():
        return first[:, None]
    samples = _ramp_samples(approach.ramp, first, channels, sample_rate)
    rise = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, samples + 1)))
    # One exactly where it settles.
    shape = np.concatenate([rise[:-1], np.ones(round(approach.settle * sample_rate) + 1)])
    return first[:, None] * shape


def lead_out(approach: Approach, heading: np.ndarray, channels: Sequence[DriveChannel], rate: float) -> np.ndarray:
    """Return the commands from the one that a rig is on its way to, to zero.

    Zero exactly from the end of the ramp on; the last column is only looked ahead to.
    """
    samples = _ramp_samples(approach.ramp_down, heading, channels, rate)
    fall = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, samples + 1)))
    shape = np.concatenate([fall[:-1], np.zeros(round(approach.hold * rate) + 1)])
    return heading[:, None] * shape


def _ramp_samples(seconds: float, height: np.ndarray, channels: Sequence[DriveChannel], sample_rate: float) -> int:
    """Return the length of a ramp of these heights: a raised cosine of height h in T moves at pi h / (2 T) at most."""
    needed = [
        0.5 * np.pi * abs(value) / channel.slew_limit
        for value, channel in zip(height, channels, strict=True)
        if channel.slew_limit > 0.0
    ]
    return int(np.ceil(max(seconds, *needed, 0.0) * sample_rate))


@dataclass(frozen=True)
class Use:
    """Use of the actuator by one drive channel; a channel without an actuator (a road) has a peak only."""

    drive: str
    #: Largest magnitude of the drive over the limit in that direction, 0 to 1.
    peak_command_ratio: float
    #: Share of the time in which the valve was at its stop or the load pressure at its limit, 0 to 1.
    saturated_share: float
    #: Largest difference of command and achieved value, in the drive's unit.
    largest_following_error: float
    #: Largest load pressure over what the supply could press with at that moment, 0 to 1; 1 is a stall.
    largest_load_pressure_share: float = 0.0
    #: Of the actuator's supply, in Pa.
    lowest_supply_pressure: float = 0.0


class RigFaultError(RuntimeError):
    """A playback that could not be brought to its end, in one sentence."""


@dataclass(frozen=True)
class Block:
    """A piece of a playback, (channels, samples) each; samples before the drive's first one have negative numbers."""

    first_sample: int
    drive: np.ndarray
    response: np.ndarray
    #: For watchdogs: command less achieved value, zero where no actuator follows, and monitored values.
    following_error: np.ndarray
    monitored: np.ndarray

    @property
    def end(self) -> int:
        """The sample after its last."""
        return self.first_sample + self.drive.shape[1]


class DrivePlayback(ABC):
    """One playback under way: iterate over `approach()`, then `blocks()`; then read `response` and `uses()`.

    The drive (drives, samples) is checked, each row in its channel's unit; every block but the last has
    `block_samples`.
    """

    #: Whether it has to be held back to real time; not what was played before its first block.
    is_paced = True

    def __init__(
        self,
        drive: np.ndarray,
        *,
        channels: Sequence[DriveChannel],
        approach: Approach,
        sample_rate: float,
        responses: int,
        block_samples: int,
    ) -> None:
        self._drive = np.ascontiguousarray(drive, dtype=np.float64)
        self._channels = tuple(channels)
        self._approach = approach
        self._rate = sample_rate
        self._lead_in = lead_in(approach, self._drive[:, 0], channels, sample_rate)
        #: The next sample; negative before the drive begins.
        self._next = 1 - self._lead_in.shape[1]
        # What the rig is on its way to: linear between samples, it looks one ahead.
        self._heading = np.zeros(len(self._drive))
        #: May be made smaller before it plays, see `cut`; the bytes of an engine with fixed steps do not depend on it.
        self.block_samples = block_samples
        self.response = np.empty((responses, self._drive.shape[1]))
        self._calculate: Callable[[np.ndarray], np.ndarray] | None = None

    @property
    def samples_done(self) -> int:
        """Samples of the drive that were played."""
        return max(self._next, 0)

    @property
    def rests_at_zero(self) -> bool:
        """Whether all drives are at zero, so that there is nothing to ramp down."""
        return not self._heading.any()

    def cut(self, seconds: float) -> None:
        """Play blocks no longer than so many seconds, so that a playback in real time hears of a stop soon."""
        self.block_samples = min(self.block_samples, max(round(seconds * self._rate), 1))

    def calculate(self, rows: Callable[[np.ndarray], np.ndarray]) -> None:
        """Add to every block the rows that are calculated from its response; called before it plays."""
        self._calculate = rows
        self.response = np.empty((len(self.response) + len(rows(self.response[:, :1])), self.response.shape[1]))

    def frames(self) -> np.ndarray | None:
        """Return where the bodies are now, (bodies, 12): rotation row by row, then origin in m; None without bodies."""
        return None

    def approach(self) -> Iterator[Block]:
        """Go from rest to the drive's first sample and settle there, block by block; nothing where that is zero."""
        while self._next < 0:
            yield self._go_on(self._ahead(), counted=False)

    def blocks(self) -> Iterator[Block]:
        """Play the drive on, block by block, after the approach where that was not iterated over; the last is shorter.

        Raises `RigFaultError` where the rig cannot continue; names what happened and when.
        """
        for _ in self.approach():
            pass
        while self._next < self._drive.shape[1]:
            first = self._next
            block = self._go_on(self._ahead(), counted=True)
            self.response[:, first : block.end] = block.response
            yield block

    def _ahead(self) -> np.ndarray:
        """Return the commands of the next block of approach or drive and the one they lead to; one column at the end.

        Nothing follows the last sample of the drive; its value is held.
        """
        if self._next < 0:
            samples = self._lead_in.shape[1] - 1
            begin = samples + self._next
            return self._lead_in[:, begin : min(begin + self.block_samples, samples) + 1]
        samples = self._drive.shape[1]
        end = min(self._next + self.block_samples, samples)
        return np.column_stack([self._drive[:, self._next : end], self._drive[:, min(end, samples - 1)]])

    def ramp_down(self) -> Iterator[Block]:
        """From where the playback was left, bring all drives to zero along a cosine and hold; blocks count on."""
        ramp = lead_out(self._approach, self._heading, self._channels, self._rate)
        left = self._next
        for begin in range(0, ramp.shape[1] - 1, self.block_samples):
            end = min(begin + self.block_samples, ramp.shape[1] - 1)
            block = self._with_calculated(self._advance(ramp[:, begin : end + 1], left + begin, counted=False))
            self._heading = ramp[:, end]
            yield block

    def end(self) -> None:  # noqa: B027 - most have nothing to do then
        """Hear that the run is over, whatever its end, before its commander is answered.

        Raises `RigFaultError` where the rig must not play on; the gateway latches.
        """

    def peak_ratios(self) -> list[float]:
        """Return the largest magnitude of each drive so far over its limit in that direction, 0 to 1."""
        played = self._drive[:, : max(self.samples_done, 1)]
        ratios = []
        for channel, row in zip(self._channels, played, strict=True):
            up, down = row.max(), row.min()
            ratios.append(
                float(max(up / channel.maximum if up > 0 else 0.0, down / channel.minimum if down < 0 else 0.0))
            )
        return ratios

    @abstractmethod
    def uses(self) -> list[Use]:
        """Return how every drive channel used its actuator so far; ramps do not count."""

    @abstractmethod
    def _advance(self, commands: np.ndarray, first: int, *, counted: bool) -> Block:
        """Play the columns of `commands` but the last, which they lead to; return them with what the sensors say.

        What is counted belongs to the drive itself, and to how much of its actuators it used.
        """

    def _go_on(self, commands: np.ndarray, *, counted: bool) -> Block:
        block = self._with_calculated(self._advance(commands, self._next, counted=counted))
        # A rig that is stopped may break a block off.
        self._heading = commands[:, block.end - self._next]
        self._next = block.end
        return block

    def _with_calculated(self, block: Block) -> Block:
        if self._calculate is None:
            return block
        return replace(block, response=np.vstack([block.response, self._calculate(block.response)]))
