"""A stream into the viewer's file and a running viewer: opened, closed and released."""

from __future__ import annotations

import gc
import os
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import structlog

# Rerun has no setting in its API against usage reports; this variable is how it is told, before it is imported.
os.environ.setdefault("CI", "1")

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings

APPLICATION: Final = "duralab"

FLUSH_SECONDS: Final = 5.0
"""Longest wait for the file (and a viewer) to take what is left, when a recording is closed."""

PROBE_SECONDS: Final = 0.5
"""Longest wait for a sign that a viewer listens."""

DEFAULT_PORT: Final = 9876
"""Where a Rerun viewer listens when nothing else is said."""


@dataclass(frozen=True)
class LiveStream:
    """An open stream, and whether a viewer takes it while it is written."""

    stream: rr.RecordingStream
    watched: bool


def open_stream(recording: str, *, file: Path | None, viewer: str | None) -> LiveStream:
    """Open a stream."""
    stream = rr.RecordingStream(APPLICATION, recording_id=recording)
    sinks: list[rr.FileSink | rr.GrpcSink] = []
    if file is not None:
        sinks.append(rr.FileSink(file))
    # Rerun would keep everything for a viewer that is not there and wait for it at every turn.
    watched = viewer is not None and _listens(viewer)
    if viewer is not None and watched:
        sinks.append(rr.GrpcSink(viewer))
    stream.set_sinks(*sinks)
    stream.send_recording_name(recording)
    return LiveStream(stream, watched)


def send_blueprint(stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
    """Send a layout.

    As `rr.send_blueprint` does, whose stream is never released: it and what keeps it in memory hold each other, two
    threads and a megabyte for each layout. Here it is disconnected.
    """
    own = rr.RecordingStream._from_native(  # noqa: SLF001 - there is no public way to a stream of a layout
        rerun_bindings.new_blueprint(
            application_id=APPLICATION, make_default=False, make_thread_default=False, default_enabled=True
        )
    )
    own.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(own)  # noqa: SLF001 - likewise
    kept = own.memory_recording()
    active, default = True, True
    rerun_bindings.send_blueprint(kept.storage, active, default, recording=stream.to_native())
    own.disconnect()


def close_stream(stream: rr.RecordingStream) -> bool:
    """Write what is left, as far as it is taken in time, close everything, and return whether all was taken."""
    taken = True
    try:
        stream.flush(timeout_sec=FLUSH_SECONDS)
    except RuntimeError as error:
        structlog.get_logger("recorder").warning("the file or the viewer does not take the view", why=str(error))
        taken = False
    stream.disconnect()
    return taken


def release_streams() -> None:
    """Release what Rerun keeps of streams that nobody holds any more: two threads and some megabytes each.

    It does so by itself only in `rr.init`, which a process with several streams never calls.
    """
    # A stream is part of reference cycles, and only what is gone is released.
    gc.collect()
    rerun_bindings.flush_and_cleanup_orphaned_recordings()


def _listens(viewer: str) -> bool:
    address = urlsplit(viewer)
    try:
        with socket.create_connection((address.hostname or "", address.port or DEFAULT_PORT), timeout=PROBE_SECONDS):
            return True
    except OSError as error:
        structlog.get_logger("recorder").warning(
            "no viewer listens; the view goes on without", viewer=viewer, why=str(error)
        )
        return False
