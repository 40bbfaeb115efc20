"""Endurance tests on the page: progress and trends."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from duralab import InputError
from duralab.lab import EnduranceHistory, EndurancePhase, EnduranceProgress, Lab
from operator_page.documents import alarm_document, endurance_document, numbers
from operator_page.endurance_trends import STATISTICS, Trends

MOST_TESTS: Final = 5
"""Number of ended tests that stay in view, the last ones."""
MOST_KEPT: Final = 200
SILENT_SECONDS: Final = 10.0
"""Time without a status after which a sequencer counts as gone: it sends one at least every second."""

_ENDED: Final = (EndurancePhase.FINISHED, EndurancePhase.STOPPED, EndurancePhase.FAULTED)


@dataclass
class _SeenTest:
    progress: EnduranceProgress
    history: EnduranceHistory
    heard: float
    trends: Trends | None = None
    # Number of repeats read from the recording; their alarms before the page knew the test are not reported.
    read: int = 0
    caught_up: bool = False
    complete: bool = False

    @property
    def ended(self) -> bool:
        return self.progress.phase in _ENDED


class EnduranceView:
    """Endurance tests of a lab; safe for threads.

    `lock`: Lock of the lab view: two locks would be acquired in both orders. `say`: Adds a line to its log.
    """

    def __init__(self, lab: Lab, *, lock: threading.RLock, say: Callable[..., None]) -> None:
        self._lab, self._lock, self._say = lab, lock, say
        self._tests: dict[str, _SeenTest] = {}

    def take(self, progress: EnduranceProgress) -> None:
        """Update the progress of a test."""
        with self._lock:
            known = self._tests.get(progress.id)
            if known is None:
                history = self._lab.endurance(progress.id).history()
                known = self._tests[progress.id] = _SeenTest(progress, history, time.time())
                self._say(f"The endurance test {progress.id} is {progress.phase}.")
            elif known.progress.phase != progress.phase:
                why = f": {progress.reason}" if progress.reason else "."
                self._say(
                    f"{progress.id}: {progress.phase}{why}",
                    trouble=progress.phase in (EndurancePhase.HOLDING, EndurancePhase.FAULTED),
                )
                # If it is resumed after a crash, reading continues.
                known.complete = known.complete and progress.phase in _ENDED
            known.progress, known.heard = progress, time.time()
            ended = [id for id, each in self._tests.items() if each.ended]
            for id in ended[: max(0, len(ended) - MOST_TESTS)]:
                del self._tests[id]

    def read(self) -> bool:
        """Read the newly recorded steps; return whether there were any."""
        with self._lock:
            waiting = [each for each in self._tests.values() if not each.complete]
        found = [self._read(test) for test in waiting]
        return any(found)

    def _read(self, test: _SeenTest) -> bool:
        ended = test.ended
        found = test.history.read()
        responses = [] if test.trends is not None else self._responses(test)
        with self._lock:
            schedule = test.history.schedule
            if test.trends is None and schedule is not None and test.history.columns:
                test.trends = Trends(
                    schedule.monitoring,
                    list(schedule.events),
                    responses=responses,
                    columns=test.history.columns,
                )
            for repeat in found:
                if test.trends is not None:
                    test.trends.put(repeat)
                for alarm in repeat.alarms if test.caught_up else ():
                    self._say(f"{test.progress.id}: {alarm.level}: {alarm.sentence}", trouble=True)
            test.read += len(found)
            test.caught_up = test.caught_up or test.read >= test.progress.played
            # The last step may be written just before the end is reported: it is read once more after the end.
            test.complete = ended and not found and test.read >= test.progress.played
        return bool(found)

    def _responses(self, test: _SeenTest) -> list[str]:
        return list(test.progress.damage) or [each.name for each in self._lab.describe(test.progress.rig).responses]

    def on(self, rig: str) -> list[str]:
        """Return the running tests on a rig."""
        with self._lock:
            return [id for id, each in self._tests.items() if each.progress.rig == rig and not each.ended]

    def silent(self, id: str, now: float) -> bool:
        """Return whether the sequencer of a running test has stopped sending."""
        with self._lock:
            test = self._tests.get(id)
            return test is not None and not test.ended and now - test.heard > SILENT_SECONDS

    def progress(self, id: str) -> EnduranceProgress:
        """Return the progress of a test; raises InputError if the page does not know its name."""
        return self._known(id).progress

    def _known(self, id: str) -> _SeenTest:
        with self._lock:
            if (found := self._tests.get(id)) is None:
                raise InputError(f"There is no endurance test {id!r} under way; resume it where it was broken off.")
            return found

    def documents(self, now: float) -> list[dict[str, Any]]:
        """Return the progress of all endurance tests."""
        with self._lock:
            return [
                endurance_document(each.progress, ended=each.ended, age=now - each.heard, read=each.read)
                | {"silent": self.silent(id, now)}
                for id, each in self._tests.items()
            ]

    def details(self, id: str, *, event: str, statistic: str) -> dict[str, Any]:
        """Return schedule, alarms, decisions, kept repeats, and the curves of one statistic of an event."""
        test = self._known(id)
        with self._lock:
            schedule, trends, history = test.history.schedule, test.trends, test.history
            if schedule is None or trends is None:
                return {"read": test.read, "curves": None}
            if statistic not in STATISTICS:
                raise InputError(
                    f"The statistic is {statistic!r}; give one of {', '.join(STATISTICS)}.", field="statistic"
                )
            if event not in schedule.events:
                raise InputError(f"The event is {event!r}; give one of {', '.join(schedule.events)}.", field="event")
            found = trends.curves(event, statistic)
            return {
                "read": test.read,
                "statistics": list(STATISTICS),
                "responses": trends.responses,
                "order": schedule.order.value,
                "sources": history.sources,
                "keep": {
                    "first": schedule.keep.first,
                    "every": schedule.keep.every,
                    "around": schedule.keep.around_alarm,
                },
                "actions": {"warning": schedule.actions.warning.value, "abort": schedule.actions.abort.value},
                "alarms": [alarm_document(alarm) for alarm in trends.alarms],
                "unknown": [list(each) for each in trends.unknown],
                "decisions": [list(each) for each in history.decisions[-MOST_KEPT:]],
                "kept": sorted(set(history.kept))[-MOST_KEPT:],
                "curves": {
                    **found,
                    "low": numbers(found["low"]),
                    "high": numbers(found["high"]),
                    "limits": [
                        {**each, "low": numbers(each["low"]), "high": numbers(each["high"])} for each in found["limits"]
                    ],
                },
            }
