"""Profile of a campaign: the traces of all processes as one Chrome trace, and the time of each kind of work."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Self

import psutil

from duralab.errors import InputError
from duralab.output_files import replace_when_complete
from duralab_bus import TRACE_SUFFIX, SpanKind, record_trace, write_span

PROFILE: Final = "profile.json"
"""Name of the trace file in a campaign's folder, written on request."""

_SHOWN: Final = {
    SpanKind.PLAYBACK: "playback by the rig",
    SpanKind.MATHEMATICS: "mathematics",
    SpanKind.REPORT: "writing the report",
    SpanKind.START: "starting and stopping the services",
    SpanKind.DISK: "writing and reading recordings",
    SpanKind.SERVICE: "other work of the services",
    SpanKind.WAITING: "waiting for one another",
}
"""Kinds of work by priority: if several processes work at once, the first kind counts. Last: no process works."""


@dataclass(frozen=True)
class Span:
    """Period of work of one thread, in s since 1970."""

    kind: SpanKind
    began: float
    ended: float


class Profile:
    """The spans of all processes of a lab.

    `events`: Events in Chrome's trace format, times in µs.
    """

    def __init__(self, events: Sequence[dict[str, Any]]) -> None:
        self._events = tuple(events)
        self._spans = tuple(span for track in _tracks(events) for span in _own_time(track))

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the traces of all processes from a folder; skip a line that a killed process left incomplete."""
        events = []
        for file in sorted(folder.glob(f"*{TRACE_SUFFIX}")):
            for line in file.read_text().splitlines():
                try:
                    events.append(json.loads(line))
                except ValueError:
                    continue
        return cls(events)

    def shares(self, began: float, ended: float) -> dict[SpanKind, float]:
        """Return the seconds of each kind between two times, in s since 1970; their sum is the time between them.

        Each moment counts once: in one thread for its innermost span, with several threads for the first kind of work
        in the order of `_SHOWN`.
        """
        changes = [(began, None, 0), (ended, None, 0)]
        for span in self._spans:
            first, last = max(span.began, began), min(span.ended, ended)
            if last > first:
                changes += [(first, span.kind, 1), (last, span.kind, -1)]
        changes.sort(key=lambda change: change[0])
        active, seconds = dict.fromkeys(SpanKind, 0), dict.fromkeys(_SHOWN, 0.0)
        for (at, kind, step), (until, _, _) in pairwise(changes):
            if kind is not None:
                active[kind] += step
            counted = next((kind for kind in _SHOWN if active[kind]), SpanKind.WAITING)
            seconds[counted] += until - at
        return seconds

    @property
    def period(self) -> tuple[float, float]:
        """First and last moment of all spans, in s since 1970."""
        return min(span.began for span in self._spans), max(span.ended for span in self._spans)

    def write(self, path: Path) -> None:
        """Write the profile in Chrome's trace format, for Perfetto and Chrome's tracing page."""
        start = min((event["ts"] for event in self._events if "ts" in event), default=0.0)
        shifted = [event | {"ts": event["ts"] - start} if "ts" in event else event for event in self._events]
        document = {"traceEvents": shifted, "displayTimeUnit": "ms", "otherData": {"began": start / 1e6}}
        with replace_when_complete(path) as temporary:
            temporary.write_text(json.dumps(document))

    def __str__(self) -> str:
        """Return a line for each kind, the longest first."""
        began, ended = self.period
        wall = ended - began
        shares = sorted(self.shares(began, ended).items(), key=lambda share: -share[1])
        rows = [f"{_SHOWN[kind]:<34} {seconds:7.2f} s  {100 * seconds / wall:5.1f} %" for kind, seconds in shares]
        return "\n".join([f"{'from first to last':<34} {wall:7.2f} s", *rows])


@contextmanager
def profiled(path: Path, *, show: Callable[[Profile], None]) -> Iterator[Path]:
    """Trace a block into a file, also if the block fails; yield the folder for the services' traces.

    `show`: Called with the profile after the file is written.
    """
    with tempfile.TemporaryDirectory(prefix="duralab-trace-") as name:
        folder = Path(name)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"The folder {path.parent} cannot be made: {error.strerror}; give another.") from error
        try:
            with record_trace(folder, "duralab"):
                age = _age_seconds()
                write_span("start duralab", SpanKind.START, time.time() - age, age)
                try:
                    yield folder
                finally:
                    # So that the profile lasts until nothing is left but to write it.
                    write_span("end of the command", SpanKind.START, time.time(), 1e-6)
        finally:
            profile = Profile.read(folder)
            profile.write(path)
            show(profile)


def _age_seconds() -> float:
    """Return the age of this process in seconds."""
    if sys.platform == "linux":
        # psutil's creation time is off by up to 1 s, because the kernel gives the boot time in whole seconds.
        ticks = int(Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[19])
        return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    return time.time() - psutil.Process().create_time()


def _tracks(events: Sequence[dict[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    """Yield the spans of each thread by start time; of two with the same start, the outer one first."""
    tracks: dict[tuple[int, int], list[dict[str, Any]]] = {}
    for event in events:
        if event["ph"] == "X":
            tracks.setdefault((event["pid"], event["tid"]), []).append(event)
    for track in tracks.values():
        track.sort(key=lambda event: (event["ts"], -event["dur"]))
        yield track


def _own_time(track: Sequence[dict[str, Any]]) -> Iterator[Span]:
    """Yield the periods of a thread in which a span is the innermost one."""
    open_spans: list[tuple[SpanKind, float]] = []
    at = 0.0
    for event in [*track, None]:
        begins = event["ts"] / 1e6 if event is not None else float("inf")
        while open_spans and open_spans[-1][1] <= begins:
            kind, end = open_spans.pop()
            if end > at:
                yield Span(kind, at, end)
                at = end
        if event is None:
            return
        if open_spans and begins > at:
            yield Span(open_spans[-1][0], at, begins)
        at = max(at, begins) if open_spans else begins
        end = begins + event["dur"] / 1e6
        # Clocks differ by some µs: an inner span ends with its outer one.
        open_spans.append((SpanKind(event["cat"]), min(end, open_spans[-1][1]) if open_spans else end))
