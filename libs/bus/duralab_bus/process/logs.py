"""Logs of a service: one JSON object per line on standard error."""

from __future__ import annotations

import contextlib
import logging
import sys
import threading
from typing import TextIO, cast

import structlog
from structlog.typing import EventDict, Processor, WrappedLogger


class _StandardError:
    """Writer of whole lines. A service whose log has no reader any more must still end in order."""

    def __init__(self, stream: TextIO | None) -> None:
        self._lock = threading.Lock()
        self._stream = stream

    def write(self, text: str) -> None:
        with self._lock, contextlib.suppress(BrokenPipeError):
            stream = self._stream or sys.stderr
            stream.write(text)
            stream.flush()

    def flush(self) -> None:
        """Do nothing: every line is flushed."""


def configure_logs(service: str, *, stream: TextIO | None = None) -> None:
    """Write structlog's and the standard library's logs as JSON lines with timestamp, level and service name.

    Parameters
    ----------
    service : str
        Name of the service, in every line.
    stream : TextIO, optional
        Stream for the lines; standard error if omitted.

    Notes
    -----
    Values bound by `structlog.contextvars.bind_contextvars`, such as a run, are added to every line of that thread.
    """

    def add_service(_logger: WrappedLogger, _method: str, event: EventDict) -> EventDict:
        event["service"] = service
        return event

    shared: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        add_service,
        structlog.processors.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
    ]
    lines = _StandardError(stream)
    structlog.configure(
        processors=[*shared, structlog.processors.JSONRenderer()],
        logger_factory=structlog.WriteLoggerFactory(file=cast(TextIO, lines)),
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        cache_logger_on_first_use=False,
    )
    handler = logging.StreamHandler(lines)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[
                structlog.stdlib.ProcessorFormatter.remove_processors_meta,
                structlog.processors.JSONRenderer(),
            ],
        )
    )
    logging.basicConfig(level=logging.WARNING, handlers=[handler], force=True)
