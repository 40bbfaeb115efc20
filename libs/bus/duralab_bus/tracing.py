"""Spans of time of one process, as events of Chrome's trace format, one JSON line each."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Final, TypeVar

ItemT = TypeVar("ItemT")

SUFFIX: Final = ".jsonl"
_NOTHING: Final = nullcontext()


class SpanKind(StrEnum):
    """Kind of a span."""

    PLAYBACK = "playback"
    MATHEMATICS = "mathematics"
    DISK = "disk"
    REPORT = "report"
    START = "start"
    SERVICE = "service"
    WAITING = "waiting"


class _Trace:
    """Trace file of this process; each event is appended by one write, so that a killed process loses none."""

    def __init__(self) -> None:
        self._file: int | None = None

    @property
    def is_on(self) -> bool:
        return self._file is not None

    def open(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)

    def close(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def write(self, event: str) -> None:
        if (file := self._file) is not None:
            os.write(file, (event + "\n").encode())


_trace: Final = _Trace()


@contextmanager
def record_trace(folder: Path, process: str) -> Iterator[None]:
    """Write the spans of this process to a file until the block ends; a process has one trace at a time.

    Parameters
    ----------
    folder : Path
        Existing folder in which the file `<process>.jsonl` is made.
    process : str
        Name of the process in the trace.

    Returns
    -------
    context manager
        Context in which the trace is written; yields None.

    Raises
    ------
    OSError
        If the file cannot be made.
    """
    _trace.open(folder / f"{process}{SUFFIX}")
    _trace.write(json.dumps({"ph": "M", "name": "process_name", "pid": os.getpid(), "args": {"name": process}}))
    try:
        yield
    finally:
        _trace.close()


def span(name: str, kind: SpanKind, **arguments: str | float) -> AbstractContextManager[None]:
    """Measure a span of time for the trace of this process; without a trace, do nothing.

    Parameters
    ----------
    name : str
        Name of the activity.
    kind : SpanKind
        Kind of the activity.
    arguments : str or float
        Further values of the event, by name.

    Returns
    -------
    context manager
        Context of the span; written at its end, also if it fails.
    """
    return _written(name, kind, arguments) if _trace.is_on else _NOTHING


def spans(items: Iterable[ItemT], name: str, kind: SpanKind) -> Iterator[ItemT]:
    """Measure the time to produce each item of an iterator, without the time to use it.

    Parameters
    ----------
    items : iterable
        Source of the items.
    name, kind
        As for `span`.

    Returns
    -------
    iterator
        The same items.
    """
    source = iter(items)
    while True:
        with span(name, kind):
            try:
                item = next(source)
            except StopIteration:
                return
        yield item


@contextmanager
def _written(name: str, kind: SpanKind, arguments: dict[str, str | float]) -> Iterator[None]:
    # The start on the clock that all processes of a machine share, the length on one that is never set.
    began, counted = time.time_ns(), time.perf_counter_ns()
    try:
        yield
    finally:
        write_span(name, kind, began / 1e9, (time.perf_counter_ns() - counted) / 1e9, **arguments)


def write_span(name: str, kind: SpanKind, began: float, seconds: float, **arguments: str | float) -> None:
    """Write a past span of time to the trace of this process, if there is one.

    Parameters
    ----------
    name, kind, arguments
        As for `span`.
    began : float
        Start in s since 1970.
    seconds : float
        Length in s.
    """
    thread = _quoted(threading.current_thread().name)
    more = "".join(f", {_quoted(key)}: {json.dumps(value)}" for key, value in arguments.items())
    # Written out, in half the time: a campaign has thousands of spans, which must not count much in what they measure.
    _trace.write(
        f'{{"ph": "X", "name": {_quoted(name)}, "cat": "{kind.value}", "ts": {began * 1e6}, "dur": {seconds * 1e6}, '
        f'"pid": {os.getpid()}, "tid": {threading.get_native_id()}, "args": {{"thread": {thread}{more}}}}}'
    )


@lru_cache(maxsize=1024)
def _quoted(text: str) -> str:
    return json.dumps(text)
