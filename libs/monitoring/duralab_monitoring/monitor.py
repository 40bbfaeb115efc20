"""Monitor of an endurance test: one verdict for each repeat, and a state that fits into a checkpoint."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_loads import channel_damage
from duralab_monitoring.alarms import Alarm, AlarmKind, AlarmLevel, RepeatVerdict
from duralab_monitoring.changes import ChangeWatch
from duralab_monitoring.limits import StatisticLimits
from duralab_monitoring.repeat_statistics import RepeatStatistics, statistics_table
from duralab_monitoring.residual import BandLines, Measure, Reference
from duralab_monitoring.settings import MonitoringSettings, Statistic
from duralab_spectra import as_record, require_sample_rate

_FORMAT: Final = 1
_DETECTOR_STATE: Final = ("count", "mean", "square", "averages")
_CHANGES_STATE: Final = ("latched", "undecided")
_LIMITS_STATE: Final = ("mean", "square", "latched")


class Monitor:
    """Monitor of one endurance test.

    Parameters
    ----------
    settings : MonitoringSettings
        Section `monitoring` of the schedule.
    events : sequence of str
        Names of the schedule's events.
    channels : sequence of str
        Names of the response channels, in the order of the rig.
    sample_rate : float
        Sample rate of the responses, Hz.

    Raises
    ------
    ValueError
        If a name occurs twice, a limit names a channel that the rig does not have, or a band is above half the sample
        rate.
    """

    def __init__(
        self, settings: MonitoringSettings, events: Sequence[str], *, channels: Sequence[str], sample_rate: float
    ) -> None:
        for what, names in (("event", events), ("channel", channels)):
            if not names or len(set(names)) != len(names):
                raise ValueError(f"The {what}s are {list(names)}; give at least one, each name once.")
        require_sample_rate(sample_rate)
        if settings.bands[-1] > 0.5 * sample_rate:
            raise ValueError(
                f"The highest band ends at {settings.bands[-1]:g} Hz; at {sample_rate:g} Hz it may end at "
                f"{0.5 * sample_rate:g} Hz: change monitoring.bands."
            )
        if unknown := [name for name in settings.limits if name not in channels]:
            raise ValueError(f"monitoring.limits names the channel {unknown[0]!r}; the rig has {', '.join(channels)}.")
        self._settings, self._events, self._channels = settings, tuple(events), tuple(channels)
        self._sample_rate = float(sample_rate)
        self._changes = ChangeWatch(settings, events, channels=channels)
        self._limits = StatisticLimits(
            settings, events=len(events), channels=channels, probability=self._changes.probability
        )
        self._reference_repeats = -(-settings.baseline_repeats // 2)
        self._references: dict[int, Reference] = {}
        self._repeats = np.zeros(len(events), dtype=np.int64)
        self._standing: list[Alarm] = []

    def judge(self, repeat: int, event: str, *, response: ArrayLike, command: ArrayLike | None = None) -> RepeatVerdict:
        """Judge one repeat; repeats come in the order in which they were played, each once.

        Parameters
        ----------
        repeat : int
            Repeat of the schedule, from 0.
        event : str
            Event that was played.
        response : array_like, shape (channels, samples)
            Whole response, of the same length in each repeat of the event.
        command : array_like, shape (drives, samples), optional
            Commands that were recorded with the response, by the same clock. They show the delay of the recording;
            without them the responses do.

        Returns
        -------
        RepeatVerdict
            Statistics and new alarms.

        Raises
        ------
        ValueError
            If the event is unknown, a record has another shape or a value that is not finite, or is too short for the
            bands.
        """
        number = self._number(event)
        record, reference = self._record(number, response, command)
        table = statistics_table(record[: len(self._channels)], float(self._settings.damage_exponent))
        if self._repeats[number] < self._reference_repeats:
            reference.add(record)
            self._references[number] = reference
            measures, lag = np.full((len(self._channels), 3 * len(self._settings.bands) - 2), np.nan), np.nan
        else:
            measures, lag = reference.measures(record)
        return self._judged(repeat, number, RepeatStatistics(table=table, measures=measures, lag=lag))

    def damage(self, response: ArrayLike) -> NDArray[np.float64]:
        """Return the damage of a response that is not a repeat; the state stays the same.

        Parameters
        ----------
        response : array_like, shape (channels, samples)
            Whole response.

        Returns
        -------
        ndarray, shape (channels,)
            Damage in the channel's unit to the power of the damage exponent, as `Statistic.DAMAGE` of a repeat.

        Raises
        ------
        ValueError
            If the response has another shape or a value that is not finite.
        """
        return channel_damage(self._responses(response), exponents=(float(self._settings.damage_exponent),))[:, 0]

    def passed_abort_limit(self, response: ArrayLike, *, present: ArrayLike) -> str:
        """Return the absolute abort limit that the response to a new drive passes; the state stays the same.

        Parameters
        ----------
        response : array_like, shape (channels, samples)
            Whole response to the new drive, whose playback is not a repeat.
        present : array_like, shape (channels, samples)
            Whole response to the present drive: a limit that it passes counts only if the new one is farther outside.

        Returns
        -------
        str
            Channel, statistic, value and limits of the first one, without a full stop; empty if it passes none.

        Raises
        ------
        ValueError
            If a response has another shape or a value that is not finite.
        """
        exponent = float(self._settings.damage_exponent)
        table, before = (statistics_table(self._responses(each), exponent) for each in (response, present))
        return self._limits.passed_abort(table, before)

    def standing(self, event: str) -> tuple[Alarm, ...]:
        """Return the alarms that a relearning of an event's baseline would clear, first raised first.

        Parameters
        ----------
        event : str
            Name of the event.

        Returns
        -------
        tuple of Alarm
            Limits of this event, and changes found in any event: the specimen changed for all of them.

        Raises
        ------
        ValueError
            If the event is unknown.
        """
        self._number(event)
        return tuple(alarm for alarm in self._standing if _is_cleared(alarm, event))

    def replay(self, repeat: int, event: str, statistics: RepeatStatistics, *, baseline: bytes = b"") -> RepeatVerdict:
        """Judge a repeat again from its stored statistics, without its response; restores the same state.

        Parameters
        ----------
        repeat : int
            Repeat of the schedule, from 0.
        event : str
            Event that was played.
        statistics : RepeatStatistics
            Statistics of the verdict.
        baseline : bytes
            Baseline of the event after the repeat, if the verdict has `baseline_changed`.

        Returns
        -------
        RepeatVerdict
            The same verdict as before.

        Raises
        ------
        ValueError
            If the event is unknown, or a baseline is missing or of another number of repeats.
        """
        number = self._number(event)
        if self._repeats[number] < self._reference_repeats:
            self._references[number] = self._reference(event, baseline, repeats=int(self._repeats[number]) + 1)
        return self._judged(repeat, number, statistics)

    def _judged(self, repeat: int, number: int, statistics: RepeatStatistics) -> RepeatVerdict:
        """Judge the statistics of the next repeat of an event, and learn from them."""
        event, played = self._events[number], int(self._repeats[number])
        learning, changed = played < self._settings.baseline_repeats, played < self._reference_repeats
        alarms = self._limits.judge(number, statistics.table, learnt=not learning, repeat=repeat, name=event)
        if not learning:
            alarms += self._changes.judge(repeat, event, statistics.measures)
        elif not changed:
            self._changes.learn(event, statistics.measures)
        self._standing += alarms
        self._repeats[number] += 1
        if learning:
            self._limits.learn(number, statistics.table, repeats=played + 1)
        return RepeatVerdict(
            statistics=statistics,
            alarms=tuple(sorted(alarms, key=_rank)),
            judged=not learning,
            baseline_changed=changed,
        )

    def relearn(self, event: str | None = None) -> None:
        """Learn baselines again from the next repeats on, as after a change of the drive or a repair; clear the alarms.

        Parameters
        ----------
        event : str, optional
            Event whose baseline is learnt again; all if omitted.

        Raises
        ------
        ValueError
            If the event is unknown.
        """
        for number in range(len(self._events)) if event is None else [self._number(event)]:
            self._references.pop(number, None)
            self._repeats[number] = 0
            self._limits.forget(number)
            self._changes.forget(self._events[number])
            self._standing = [alarm for alarm in self._standing if not _is_cleared(alarm, self._events[number])]

    def baseline(self, event: str) -> bytes:
        """Return the mean response of an event for storage; it changes when a verdict has `baseline_changed`.

        Parameters
        ----------
        event : str
            Name of the event.

        Returns
        -------
        bytes
            Stored form of the baseline; empty before the first repeat of the event.

        Raises
        ------
        ValueError
            If the event is unknown.
        """
        reference = self._references.get(self._number(event))
        if reference is None:
            return b""
        sizes = np.array([reference.bands.samples, reference.commands, reference.repeats])
        return _packed(sizes=sizes, lines=reference.lines, mean=reference.mean, power=reference.power)

    def state(self) -> bytes:
        """Return the state without the baselines, for the checkpoint of a repeat.

        Returns
        -------
        bytes
            State, the same for the same repeats; with six channels and six bands 14 kB, and 4 kB more for each event.
        """
        arrays = {f"{name}_{key}": getattr(part, key) for name, part, keys in self._parts() for key in keys}
        scored = np.array(self._changes.detector.scored)
        standing = np.array(json.dumps([asdict(alarm) for alarm in self._standing]))
        return _packed(of=np.array(self._identity()), repeats=self._repeats, scored=scored, standing=standing, **arrays)

    @classmethod
    def restored(
        cls,
        settings: MonitoringSettings,
        events: Sequence[str],
        *,
        channels: Sequence[str],
        sample_rate: float,
        state: bytes,
        baselines: Mapping[str, bytes],
    ) -> Monitor:
        """Return a monitor that judges the next repeat as the stored one would.

        Parameters
        ----------
        settings, events, channels, sample_rate
            Parameters of the stored monitor.
        state : bytes
            Last state of the stored monitor.
        baselines : mapping of str to bytes
            Last stored baseline of each event; events without a repeat may be omitted.

        Returns
        -------
        Monitor
            Monitor in that state.

        Raises
        ------
        ValueError
            If the state is of other settings, events or channels, or a baseline is missing or older than the state.
        """
        monitor = cls(settings, events, channels=channels, sample_rate=sample_rate)
        arrays = _unpacked(state)
        if str(arrays.get("of")) != monitor._identity():
            raise ValueError(
                "The state of the monitor belongs to other settings, events or channels; resume with the schedule that "
                "the endurance test was started with."
            )
        for name, part, keys in monitor._parts():
            for key in keys:
                setattr(part, key, arrays[f"{name}_{key}"])
        monitor._repeats = arrays["repeats"]
        monitor._changes.detector.scored = int(arrays["scored"])
        # A state of an earlier version has no alarms.
        monitor._standing = [_alarm(stored) for stored in json.loads(str(arrays.get("standing", "[]")))]
        for number, event in enumerate(events):
            if wanted := min(int(monitor._repeats[number]), monitor._reference_repeats):
                monitor._references[number] = monitor._reference(event, baselines.get(event, b""), repeats=wanted)
        return monitor

    def _reference(self, event: str, stored: bytes, *, repeats: int) -> Reference:
        found: dict[str, Any] = _unpacked(stored) if stored else {"sizes": (0, 0, 0)}
        samples, commands, stored_repeats = (int(size) for size in found["sizes"])
        if stored_repeats != repeats:
            raise ValueError(
                f"The baseline of {event} is the mean of {stored_repeats} repeats and the state needs that of "
                f"{repeats}; give the one that was stored with the state or last before it."
            )
        bands = BandLines.of(self._settings.bands, samples=samples, sample_rate=self._sample_rate)
        return Reference(bands, commands, repeats, found["lines"], found["mean"], found["power"])

    def _parts(self) -> tuple[tuple[str, object, tuple[str, ...]], ...]:
        """Return the parts whose arrays are the state, and the arrays' names."""
        return (
            ("detector", self._changes.detector, _DETECTOR_STATE),
            ("changes", self._changes, _CHANGES_STATE),
            ("limits", self._limits, _LIMITS_STATE),
        )

    def _identity(self) -> str:
        parts = [_FORMAT, self._settings.model_dump(mode="json"), self._events, self._channels, self._sample_rate]
        return json.dumps(parts, sort_keys=True)

    def _number(self, event: str) -> int:
        if event not in self._events:
            raise ValueError(f"The event {event!r} is not in the schedule; it has {', '.join(self._events)}.")
        return self._events.index(event)

    def _responses(self, response: ArrayLike) -> NDArray[np.float64]:
        record = as_record(response, name="response")
        if record.shape[0] != len(self._channels):
            raise ValueError(f"The response has {record.shape[0]} channels; the rig has {len(self._channels)}.")
        return record

    def _record(
        self, number: int, response: ArrayLike, command: ArrayLike | None
    ) -> tuple[NDArray[np.float64], Reference]:
        """Return responses and commands in one record, and its reference."""
        record = self._responses(response)
        if command is not None:
            commanded = as_record(command, name="command")
            if commanded.shape[1] != record.shape[1]:
                raise ValueError(
                    f"The command has {commanded.shape[1]} samples and the response {record.shape[1]}; give both of "
                    "the whole repeat."
                )
            record = np.concatenate([record, commanded])
        commands = record.shape[0] - len(self._channels)
        known = self._references.get(number)
        if known is None:
            bands = BandLines.of(self._settings.bands, samples=record.shape[1], sample_rate=self._sample_rate)
            return record, Reference.empty(bands, channels=len(self._channels), commands=commands)
        if (known.bands.samples, known.commands) != (record.shape[1], commands):
            raise ValueError(
                f"The repeat of {self._events[number]} has {record.shape[1]} samples and {commands} commands, its "
                f"baseline {known.bands.samples} and {known.commands}; give the whole repeat, or learn the baseline "
                "again."
            )
        return record, known


def _is_cleared(alarm: Alarm, event: str) -> bool:
    """Whether a relearning of an event clears an alarm."""
    return alarm.kind is not AlarmKind.LIMIT or alarm.event == event


def _alarm(stored: dict[str, Any]) -> Alarm:
    kind, measure = AlarmKind(stored["kind"]), stored["measure"]
    typed = {
        "level": AlarmLevel(stored["level"]),
        "kind": kind,
        "measure": Statistic(measure) if kind is AlarmKind.LIMIT else Measure(measure),
        "band": None if stored["band"] is None else tuple(stored["band"]),
    }
    return Alarm(**{**stored, **typed})


def _rank(alarm: Alarm) -> tuple[int, bool, float]:
    return -alarm.level, alarm.kind is AlarmKind.LIMIT, -abs(alarm.size)


def _packed(**arrays: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _unpacked(stored: bytes) -> dict[str, NDArray[Any]]:
    try:
        with np.load(io.BytesIO(stored), allow_pickle=False) as arrays:
            return dict(arrays)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(
            f"The {len(stored)} bytes are no state and no baseline of a monitor ({error}); give what `state` or "
            "`baseline` returned."
        ) from error
