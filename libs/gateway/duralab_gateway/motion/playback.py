"""Playback of a drive block by block, on any rig: approach, drive, and ramp back to rest."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field


class Approach(BaseModel):
    """Times of a rig's ramps to a drive's first sample and back; a slew limit makes a ramp longer."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    #: Time from rest to the first sample, in s; 0 for a rig that may begin with a step.
    ramp: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    #: Time for which the first sample is held before the drive begins, in s.
    settle: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    #: Time of the ramp from the end of a playback to zero, and time for which zero is held then, in s. A stop waits for
    #: both.
    ramp_down: Annotated[float, Field(gt=0.0, le=10.0)] = 0.5
    hold: Annotated[float, Field(ge=0.0, le=10.0)] = 0.1


class DriveChannel(Protocol):
    """Drive channel: its name and limits, as needed by a playback."""

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
        """Largest rate, in unit per second; 0 if none is stated."""
        ...


def lead_in(approach: Approach, first: np.ndarray, channels: Sequence[DriveChannel], sample_rate: float) -> np.ndarray:
    """Return the commands from rest to a drive's first sample, which is their last column.

    No samples if the first sample is zero, or if the rig begins with a step.
    """
    if approach.ramp == 0.0 or not first.any():
        return first[:, None]
    samples = _ramp_samples(approach.ramp, first, channels, sample_rate)
    rise = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, samples + 1)))
    # Exactly one while it settles.
    shape = np.concatenate([rise[:-1], np.ones(round(approach.settle * sample_rate) + 1)])
    return first[:, None] * shape


def lead_out(approach: Approach, heading: np.ndarray, channels: Sequence[DriveChannel], rate: float) -> np.ndarray:
    """Return the commands from the present one to zero.

    Exactly zero from the end of the ramp on; the last column is not played, only interpolated to.
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
    #: Largest ratio of load pressure to available supply pressure at that moment, 0 to 1; 1 is a stall.
    largest_load_pressure_share: float = 0.0
    #: Lowest pressure of the actuator's supply, in Pa.
    lowest_supply_pressure: float = 0.0


class RigFaultError(RuntimeError):
    """Fault that ends a playback early, in one sentence."""


@dataclass(frozen=True)
class Block:
    """Piece of a playback, (channels, samples) each; samples before the drive's first one have negative numbers."""

    first_sample: int
    drive: np.ndarray
    response: np.ndarray
    #: For watchdogs: command less achieved value, zero if no actuator follows, and monitored values.
    following_error: np.ndarray
    monitored: np.ndarray

    @property
    def end(self) -> int:
        """Number of the sample after its last."""
        return self.first_sample + self.drive.shape[1]


class DrivePlayback(ABC):
    """One playback: iterate over `approach()`, then `blocks()`; then read `response` and `uses()`.

    The drive (drives, samples) is checked, each row in its channel's unit; every block but the last has
    `block_samples`.
    """

    #: Whether it must be delayed to real time; False if it was played before its first block.
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
        #: Number of the next sample; negative before the drive begins.
        self._next = 1 - self._lead_in.shape[1]
        # Next command value: commands are linear between samples, so a block looks one ahead.
        self._heading = np.zeros(len(self._drive))
        #: May be reduced before it plays, see `cut`; the bytes of an engine with fixed steps do not depend on it.
        self.block_samples = block_samples
        self.response = np.empty((responses, self._drive.shape[1]))
        self._calculate: Callable[[np.ndarray], np.ndarray] | None = None

    @property
    def samples_done(self) -> int:
        """Number of played samples of the drive."""
        return max(self._next, 0)

    @property
    def rests_at_zero(self) -> bool:
        """Whether all drives are at zero, so that no ramp down is needed."""
        return not self._heading.any()

    def cut(self, seconds: float) -> None:
        """Play blocks no longer than `seconds`, so that a playback in real time soon notices a stop."""
        self.block_samples = min(self.block_samples, max(round(seconds * self._rate), 1))

    def calculate(self, rows: Callable[[np.ndarray], np.ndarray]) -> None:
        """Add calculated rows to the response of every block; called before it plays."""
        self._calculate = rows
        self.response = np.empty((len(self.response) + len(rows(self.response[:, :1])), self.response.shape[1]))

    def instants(self) -> Sequence[int]:
        """Return numbers of samples done, in the last block, for which `frames` can be requested."""
        return (self.samples_done,)

    def frames(self, instants: Sequence[int]) -> np.ndarray | None:
        """Return frames at some of the `instants`, (instants, bodies, 12), or None if there are no bodies.

        A frame is a rotation row by row, then an origin in m.
        """
        return None

    def play_ahead(self, samples: int, ends_run: Callable[[Block], object]) -> None:  # noqa: B027 - most rigs cannot
        """Let a simulation play blocks of up to `samples`: each costs some time, whatever its length.

        A block that ends the run, by `ends_run` or a fault, is taken back and played in blocks of the usual length, so
        the run ends where it would have ended with these. A rig that cannot take back what it did does nothing here.
        """

    def approach(self) -> Iterator[Block]:
        """Move from rest to the drive's first sample and settle there, block by block; nothing if it is zero."""
        while self._next < 0:
            yield self._go_on(self._ahead(), counted=False)

    def blocks(self) -> Iterator[Block]:
        """Play the drive block by block, after the approach if that was not iterated over; the last block is shorter.

        Raises `RigFaultError` if the rig cannot continue; it names the event and its time.
        """
        for _ in self.approach():
            pass
        while self._next < self._drive.shape[1]:
            first = self._next
            block = self._go_on(self._ahead(), counted=True)
            self.response[:, first : block.end] = block.response
            yield block

    def _ahead(self) -> np.ndarray:
        """Return the commands of the next block of approach or drive, and the command after it; one column at the end.

        No command follows the last sample of the drive; its value is held.
        """
        if self._next < 0:
            samples = self._lead_in.shape[1] - 1
            begin = samples + self._next
            return self._lead_in[:, begin : min(begin + self.block_samples, samples) + 1]
        samples = self._drive.shape[1]
        end = self._next + self.block_samples
        if end < samples:
            return self._drive[:, self._next : end + 1]
        return np.column_stack([self._drive[:, self._next :], self._drive[:, -1]])

    def ramp_down(self) -> Iterator[Block]:
        """Bring all drives from their present value to zero along a cosine and hold; block numbers continue."""
        ramp = lead_out(self._approach, self._heading, self._channels, self._rate)
        left = self._next
        for begin in range(0, ramp.shape[1] - 1, self.block_samples):
            end = min(begin + self.block_samples, ramp.shape[1] - 1)
            block = self._with_calculated(self._advance(ramp[:, begin : end + 1], left + begin, counted=False))
            self._heading = ramp[:, end]
            yield block

    def end(self) -> None:  # noqa: B027 - most playbacks need no action
        """Handle the end of the run, of any kind, before the commander gets the answer.

        Raises `RigFaultError` if the rig must not play again; the gateway latches.
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
        """Return the use of the actuator of every drive channel so far; ramps do not count."""

    @abstractmethod
    def _advance(self, commands: np.ndarray, first: int, *, counted: bool) -> Block:
        """Play the columns of `commands` but the last, which follows them; return them with the measured signals.

        `counted` blocks are part of the drive itself, and count for the use of the actuators.
        """

    def _go_on(self, commands: np.ndarray, *, counted: bool) -> Block:
        block = self._with_calculated(self._advance(commands, self._next, counted=counted))
        # A rig that is stopped may end a block early.
        self._heading = commands[:, block.end - self._next]
        self._next = block.end
        return block

    def _with_calculated(self, block: Block) -> Block:
        if self._calculate is None:
            return block
        return replace(block, response=np.vstack([block.response, self._calculate(block.response)]))
