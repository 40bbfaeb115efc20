"""What a step of the target editor did, in figures, in words, and in the words of the contract."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from duralab.signals import Signals
from duralab_proto.v1 import iterator_pb2


@dataclass(frozen=True)
class ChannelRecord:
    """What a step did to one channel.

    Parameters
    ----------
    channel : str
        Its name.
    energy_removed : float
        Share of the channel's energy, the time integral of its square with its static part, that is gone; negative
        where some came in.
    spikes : int or None
        How many were replaced; None where none was looked for.
    damage_kept : float or None
        Pseudo-damage after over before; None where none was counted.
    """

    channel: str
    energy_removed: float
    spikes: int | None = None
    damage_kept: float | None = None


@dataclass(frozen=True)
class StepRecord:
    """What a step did.

    Parameters
    ----------
    name : str
        As the campaign file names it, e.g. "cut".
    settings : str
        All of its settings, defaults too, as YAML on one line.
    samples_before, samples_after : int
        Of each channel.
    sample_rate_before, sample_rate_after : float
        In hertz.
    channels : tuple of ChannelRecord
        In the target's order.
    sections : tuple of tuple of float
        Start and end of what was kept, in seconds of the target before the step, where it kept stretches.
    """

    name: str
    settings: str
    samples_before: int
    samples_after: int
    sample_rate_before: float
    sample_rate_after: float
    channels: tuple[ChannelRecord, ...]
    sections: tuple[tuple[float, float], ...] = ()

    @property
    def seconds_before(self) -> float:
        """Length before the step, in seconds."""
        return self.samples_before / self.sample_rate_before

    @property
    def seconds_after(self) -> float:
        """Length after the step, in seconds."""
        return self.samples_after / self.sample_rate_after

    @property
    def finding(self) -> str:
        """What it did, in words, e.g. "60 s became 12.5 s; energy removed: 1.2 to 8 %"."""
        parts = []
        if self.sample_rate_before != self.sample_rate_after:
            parts.append(f"{self.sample_rate_before:g} Hz became {self.sample_rate_after:g} Hz")
        elif self.samples_before != self.samples_after:
            parts.append(f"{self.seconds_before:g} s became {self.seconds_after:g} s")
        if len(self.sections) > 1:
            parts.append(f"{len(self.sections)} sections joined")
        counted = {channel.channel: channel.spikes for channel in self.channels if channel.spikes is not None}
        if counted:
            where = ", ".join(f"{name} {count}" for name, count in counted.items() if count)
            parts.append(f"spikes replaced: {where}" if where else "no spike found")
        kept = {channel.channel: channel.damage_kept for channel in self.channels if channel.damage_kept is not None}
        if kept:
            parts.append("damage kept: " + ", ".join(f"{name} {100 * share:.1f} %" for name, share in kept.items()))
        shares = [100 * channel.energy_removed for channel in self.channels]
        least, most = f"{min(shares):.3g}", f"{max(shares):.3g}"
        parts.append(f"energy removed: {least if least == most else f'{least} to {most}'} %")
        return "; ".join(parts)

    def __str__(self) -> str:
        return f"{self.name} {self.settings}: {self.finding}"

    def to_message(self) -> iterator_pb2.TargetStep:
        """Encode the record."""
        message = iterator_pb2.TargetStep(
            name=self.name,
            settings=self.settings,
            finding=self.finding,
            samples_before=self.samples_before,
            samples_after=self.samples_after,
            sample_rate_before=self.sample_rate_before,
            sample_rate_after=self.sample_rate_after,
        )
        for channel in self.channels:
            message.channels.add(
                channel=channel.channel,
                energy_removed=channel.energy_removed,
                spikes=channel.spikes,
                damage_kept=channel.damage_kept,
            )
        for start, end in self.sections:
            message.sections.add(start_seconds=start, end_seconds=end)
        return message

    @classmethod
    def from_message(cls, message: iterator_pb2.TargetStep) -> Self:
        """Decode a record."""
        return cls(
            name=message.name,
            settings=message.settings,
            samples_before=message.samples_before,
            samples_after=message.samples_after,
            sample_rate_before=message.sample_rate_before,
            sample_rate_after=message.sample_rate_after,
            channels=tuple(
                ChannelRecord(
                    channel=entry.channel,
                    energy_removed=entry.energy_removed,
                    spikes=entry.spikes if entry.HasField("spikes") else None,
                    damage_kept=entry.damage_kept if entry.HasField("damage_kept") else None,
                )
                for entry in message.channels
            ),
            sections=tuple((section.start_seconds, section.end_seconds) for section in message.sections),
        )


def step_record(
    *,
    name: str,
    settings: str,
    before: Signals,
    after: Signals,
    spikes: Mapping[str, int],
    damage_kept: Mapping[str, float],
    sections: Iterable[tuple[float, float]],
) -> StepRecord:
    """Compare the target before a step with that after it.

    Parameters
    ----------
    name, settings : str
        Of the step, as in `StepRecord`.
    before, after : Signals
        The same channels.
    spikes, damage_kept : mapping
        By channel; empty where the step does not look for it.
    sections : iterable of tuple of float
        As in `StepRecord`.
    """
    energies = [np.sum(signals.samples**2, axis=1) / signals.sample_rate for signals in (before, after)]
    removed = [1.0 - float(left) / float(there) if there > 0.0 else 0.0 for there, left in zip(*energies, strict=True)]
    return StepRecord(
        name=name,
        settings=settings,
        samples_before=before.samples.shape[1],
        samples_after=after.samples.shape[1],
        sample_rate_before=before.sample_rate,
        sample_rate_after=after.sample_rate,
        channels=tuple(
            ChannelRecord(channel, share, spikes.get(channel), damage_kept.get(channel))
            for channel, share in zip(before.names, removed, strict=True)
        ),
        sections=tuple(sections),
    )
