"""Reader of an endurance test's recordings: statistics of every repeat, alarms, and kept samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from google.protobuf.message import Message
from pydantic import ValidationError

from duralab.data import Signals, channels_of
from duralab.errors import InputError
from duralab.recording.files import RecordingFiles, SignalWindows, input_errors
from duralab_proto.arrays import from_array
from duralab_proto.v1 import rig_pb2, sequencer_pb2
from duralab_recordings import check_samples, within_contract
from duralab_schedules import Schedule
from duralab_settings import YamlError, explain_validation, parse_yaml

MessageT = TypeVar("MessageT", bound=Message)


@dataclass(frozen=True, eq=False)
class EnduranceRepeats:
    """Values of every counted repeat; NaN if its end is unknown.

    `repeat`, `event`, `drive`, shape (repeats,): Number from 0, index of its event, index of the played drive. `known`,
    `kept`, shape (repeats,): Whether it was played to its end; whether all its samples are recorded. `statistics`,
    shape (repeats, responses, columns): Columns as in `EnduranceRecording.columns`; float32. `damage`, shape (repeats,
    responses): Counted damage; NaN if unknown.
    """

    repeat: np.ndarray
    event: np.ndarray
    drive: np.ndarray
    known: np.ndarray
    kept: np.ndarray
    statistics: np.ndarray
    damage: np.ndarray

    def __len__(self) -> int:
        """Return the number of repeats."""
        return self.repeat.size


class EnduranceRecording:
    """Recordings of one endurance test in one folder.

    `path`: Path of one of the recordings.
    Raises `InputError`: It is not a recording of an endurance test, or one of them is missing or damaged.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        opened = RecordingFiles(self.path)
        volume = next(opened.messages(sequencer_pb2.EnduranceVolume), None)
        if volume is None:
            raise InputError(f"The recording {self.path} is not that of an endurance test; give one of those.")
        first = self.path.with_name(f"{volume.id}.mcap") if volume.number > 1 else self.path
        self.volumes = [opened if first == self.path else RecordingFiles(first)]
        while (following := first.with_name(f"{volume.id}-v{len(self.volumes) + 1:04d}.mcap")).is_file():
            self.volumes.append(RecordingFiles(following))

    @property
    def files(self) -> tuple[Path, ...]:
        """All files of the test, in order."""
        return tuple(Path(path) for volume in self.volumes for path in volume.paths)

    def messages(self, kind: type[MessageT]) -> Iterator[MessageT]:
        """Yield the messages of one type from all recordings, in order."""
        for volume in self.volumes:
            yield from volume.messages(kind)

    @cached_property
    def specification(self) -> sequencer_pb2.EnduranceSpec:
        """Specification of the test."""
        return self._first(sequencer_pb2.EnduranceSpec)

    @cached_property
    def rig(self) -> rig_pb2.RigDescription:
        """Description of the rig."""
        return self._first(rig_pb2.RigDescription)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the statistics."""
        return tuple(self._first(sequencer_pb2.EnduranceVolume).columns)

    @cached_property
    def status(self) -> sequencer_pb2.EnduranceStatus | None:
        """Final status; None if it has not ended."""
        return next(self.volumes[-1].messages(sequencer_pb2.EnduranceStatus), None)

    @cached_property
    def schedule(self) -> Schedule:
        """Schedule of the test."""
        try:
            return Schedule.model_validate(parse_yaml(self.specification.schedule))
        except ValidationError as error:
            raise InputError(f"The schedule in {self.path}: {explain_validation(error, Schedule).sentence}") from error
        except YamlError as error:
            raise InputError(f"The schedule in {self.path} is not YAML: {error}.") from error

    @property
    def responses(self) -> tuple[str, ...]:
        """Names of the responses, in the rig's order."""
        return tuple(channel.name for channel in self.rig.responses)

    @cached_property
    def alarms(self) -> tuple[sequencer_pb2.EnduranceAlarm, ...]:
        """All alarms, in order."""
        return tuple(alarm for step in self.messages(sequencer_pb2.EnduranceRepeat) for alarm in step.alarms)

    @cached_property
    def unknown(self) -> tuple[sequencer_pb2.EnduranceRepeat, ...]:
        """Repeats whose end is unknown."""
        steps = self.messages(sequencer_pb2.EnduranceRepeat)
        return tuple(step for step in steps if step.end == sequencer_pb2.REPEAT_END_UNKNOWN)

    @cached_property
    def corrections(self) -> tuple[sequencer_pb2.EnduranceCorrection, ...]:
        """Counted corrections of drives, in order; none in recordings of versions that did not count them."""
        return tuple(self.messages(sequencer_pb2.EnduranceCorrection))

    @cached_property
    def correction_damage(self) -> np.ndarray:
        """Damage of each correction, shape (corrections, responses); NaN if unknown."""
        shape = (len(self.responses),)
        with input_errors(), within_contract(self.path):
            each = [
                from_array(step.damage, field="damage", shape=shape)
                if step.HasField("damage")
                else np.full(shape, np.nan)
                for step in self.corrections
            ]
        return np.array(each, dtype=np.float64).reshape(-1, *shape)

    @cached_property
    def planned_damage(self) -> np.ndarray:
        """Planned damage of one repeat of each event, shape (events, responses); NaN if unknown."""
        shape = (len(self.responses),)
        with input_errors(), within_contract(self.path):
            return np.array(
                [
                    from_array(event.planned_damage, field="planned_damage", shape=shape)
                    if event.HasField("planned_damage")
                    else np.full(shape, np.nan)
                    for event in self.specification.events
                ]
            )

    @cached_property
    def repeats(self) -> EnduranceRepeats:
        """Values of every counted repeat."""
        responses, columns = len(self.responses), len(self.columns)
        numbers: list[tuple[int, int, int, bool, bool]] = []
        statistics, damage = [], []
        carried = {samples.repeat for samples in self.messages(sequencer_pb2.RepeatSamples)}
        with input_errors(), within_contract(self.path):
            for step in self.messages(sequencer_pb2.EnduranceRepeat):
                known, kept = step.HasField("statistics"), bool(step.samples_hash) or step.repeat in carried
                numbers.append((step.repeat, step.event, step.drive, known, kept))
                table = np.full((responses, columns), np.nan)
                if known:
                    table = from_array(step.statistics, field="statistics", shape=(responses, columns), finite=False)
                statistics.append(table.astype(np.float32))
                counted = step.HasField("damage")
                damage.append(
                    from_array(step.damage, field="damage", shape=(responses,)) if counted else [np.nan] * responses
                )
        repeat, event, drive, known, kept = np.array(numbers, dtype=np.int64).reshape(-1, 5).T
        return EnduranceRepeats(
            repeat=repeat,
            event=event,
            drive=drive,
            known=known.astype(bool),
            kept=kept.astype(bool),
            statistics=np.array(statistics, dtype=np.float32).reshape(-1, responses, columns),
            damage=np.array(damage, dtype=np.float64).reshape(-1, responses),
        )

    def response(self, repeat: int) -> Signals | None:
        """Return the response of a repeat; None if its samples were not kept."""
        place = int(np.searchsorted(self._first_repeats, repeat, "right")) - 1
        # Samples before an alarm are stored after it, which may be in the next recording.
        for volume in self.volumes[max(0, place) : place + 2]:
            for carried in volume.messages(sequencer_pb2.RepeatSamples):
                if carried.repeat == repeat:
                    with input_errors(), within_contract(self.path):
                        return Signals.from_message(carried.response, field="response")
            for step in volume.messages(sequencer_pb2.EnduranceRepeat):
                if step.repeat == repeat and step.samples_hash:
                    return self._recorded_response(volume, step)
        return None

    @cached_property
    def _first_repeats(self) -> list[int]:
        """First repeat of each recording."""
        return [volume.first_repeat for volume in self.messages(sequencer_pb2.EnduranceVolume)]

    def _recorded_response(self, volume: RecordingFiles, step: sequencer_pb2.EnduranceRepeat) -> Signals:
        windows = SignalWindows(volume.paths, played={step.run: step.signal_epoch})
        with input_errors():
            window, sample_rate = windows.whole(step.run, finished=volume.whole)
            check_samples(window, step.samples_hash, path=self.path, run=step.run)
        return Signals(channels_of(self.rig.responses), sample_rate, window.response.copy())

    def _first(self, kind: type[MessageT]) -> MessageT:
        message = next(self.messages(kind), None)
        if message is None:
            raise InputError(
                f"The recording {self.path} holds no {kind.DESCRIPTOR.name}; it was broken off too early, so give "
                "another."
            )
        return message
