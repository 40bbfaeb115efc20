"""Record of a step from a source to the target: values, text and message."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Final, Self

import numpy as np

from duralab.data.signals import Signals
from duralab_proto.v1 import iterator_pb2

READ_FILE: Final = "read_file"
"""Name of the step that reads a file, before all editing."""


@dataclass(frozen=True)
class SourceRecord:
    """Source of a response: the channel of a file and its conversion.

    `source`: Name of the channel in the file; empty if there is none and the target is zero. `source_unit`,
    `stated_unit`: Unit in the file, and unit in the campaign that replaces it; empty if there is none. `factor`: Factor
    from the file's values to the rig's unit and sign, without an offset between units; None if the target is zero.
    `peak_before`, `rms_before`: Largest magnitude and RMS in the file's unit. `peak_after`, `rms_after`: The same in
    the rig's unit.
    """

    source: str
    source_unit: str = ""
    stated_unit: str = ""
    factor: float | None = None
    peak_before: float = 0.0
    rms_before: float = 0.0
    peak_after: float = 0.0
    rms_after: float = 0.0

    @property
    def unit(self) -> str:
        """Unit used for the file's values."""
        return self.stated_unit or self.source_unit

    def __str__(self) -> str:
        """Return a description as text, e.g. "FZ_FL in kN × -1000 (sign turned), peak 4.2 became 4200"."""
        if self.factor is None:
            return "silent, the file has no channel for it"
        unit = f"{self.unit} (stated{f', the file says {self.source_unit}' if self.source_unit else ''})"
        turned = " (sign turned)" if self.factor < 0.0 else ""
        return (
            f"{self.source} in {unit if self.stated_unit else self.unit or 'no unit'} × {self.factor:g}{turned}, "
            f"peak {self.peak_before:.5g} became {self.peak_after:.5g}, RMS {self.rms_before:.5g} became "
            f"{self.rms_after:.5g}"
        )


@dataclass(frozen=True)
class ChannelRecord:
    """Record of one channel in a step.

    `channel`: Name of the channel. `energy_removed`: Removed share of the channel's energy, the time integral of its
    square with its static part; negative if energy was added. `spikes`: Number of replaced spikes; None if the step
    does not search for them. `damage_kept`: Pseudo-damage after over before; None if it was not counted. `source`:
    Source of the channel; None for a step of editing.
    """

    channel: str
    energy_removed: float
    spikes: int | None = None
    damage_kept: float | None = None
    source: SourceRecord | None = None


@dataclass(frozen=True)
class StepRecord:
    """Record of a step.

    `name`: Name in the campaign file, e.g. "cut". `settings`: All of its settings, defaults too, as YAML on one line.
    `samples_before`, `samples_after`: Number of samples of each channel. `sample_rate_before`, `sample_rate_after`:
    Sample rates in hertz. `channels`: Records in the target's order. `sections`: Start and end of the kept sections, in
    seconds of the target before the step, if it kept sections. `left_out`: Sentence that names the channels of a file
    that its reader left out; empty if it read all of them.
    """

    name: str
    settings: str
    samples_before: int
    samples_after: int
    sample_rate_before: float
    sample_rate_after: float
    channels: tuple[ChannelRecord, ...]
    sections: tuple[tuple[float, float], ...] = ()
    left_out: str = ""

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
        """Effect of the step as text, e.g. "60 s became 12.5 s; energy removed: 1.2 to 8 %"."""
        read = [f"{channel.channel}: {channel.source}" for channel in self.channels if channel.source is not None]
        if read:
            return f"{'; '.join(read)}{f'. {self.left_out}' if self.left_out else ''}"
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
            left_out=self.left_out,
        )
        for channel in self.channels:
            message.channels.add(
                channel=channel.channel,
                energy_removed=channel.energy_removed,
                spikes=channel.spikes,
                damage_kept=channel.damage_kept,
                **(asdict(channel.source) if channel.source is not None else {}),
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
                    source=_source(entry) if message.name == READ_FILE else None,
                )
                for entry in message.channels
            ),
            sections=tuple((section.start_seconds, section.end_seconds) for section in message.sections),
            left_out=message.left_out,
        )


def _source(entry: iterator_pb2.TargetStepChannel) -> SourceRecord:
    return SourceRecord(
        source=entry.source,
        source_unit=entry.source_unit,
        stated_unit=entry.stated_unit,
        factor=entry.factor if entry.HasField("factor") else None,
        peak_before=entry.peak_before,
        rms_before=entry.rms_before,
        peak_after=entry.peak_after,
        rms_after=entry.rms_after,
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
    """Compare the target before and after a step.

    `name`, `settings`, `sections`: As in `StepRecord`. `before`, `after`: Signals of the same channels. `spikes`,
    `damage_kept`: Values by channel; empty if the step does not compute them.
    Returns: Record of the changes, by channel.
    """
    # The square of a very large sample overflows; a power of two as the scale changes no digit of the ratio.
    peaks = [np.abs(signals.samples).max(axis=1, keepdims=True, initial=0.0) for signals in (before, after)]
    _, exponents = np.frexp(np.maximum(*peaks))
    energies = [
        np.sum(np.ldexp(signals.samples, -exponents) ** 2, axis=1) / signals.sample_rate for signals in (before, after)
    ]
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
