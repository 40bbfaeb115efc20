"""Streams into a Rerun file and a running viewer: opened, closed and released."""

from __future__ import annotations

import gc
import os
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import structlog

# Rerun's API has no setting that disables usage reports; this variable does, if set before the import.
os.environ.setdefault("CI", "1")

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings

APPLICATION: Final = "duralab"

FLUSH_SECONDS: Final = 5.0
"""Longest wait, in seconds, for the file and a viewer to accept the remaining data when a recording is closed."""

PROBE_SECONDS: Final = 0.5
"""Longest wait, in seconds, for a connection to a viewer."""

DEFAULT_PORT: Final = 9876
"""Default port of a Rerun viewer."""


@dataclass(frozen=True)
class LiveStream:
    """An open stream, and whether a viewer receives it while it is written."""

    stream: rr.RecordingStream
    watched: bool


def open_stream(recording: str, *, file: Path | None, viewer: str | None) -> LiveStream:
    """Open a stream."""
    stream = rr.RecordingStream(APPLICATION, recording_id=recording)
    sinks: list[rr.FileSink | rr.GrpcSink] = []
    if file is not None:
        sinks.append(rr.FileSink(file))
    # For a missing viewer Rerun would keep all data and wait at every call.
    watched = viewer is not None and _listens(viewer)
    if viewer is not None and watched:
        sinks.append(rr.GrpcSink(viewer))
    stream.set_sinks(*sinks)
    stream.send_recording_name(recording)
    return LiveStream(stream, watched)


def send_blueprint(stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
    """Send a layout.

    Like `rr.send_blueprint`, whose stream is never released: a reference cycle keeps two threads and a megabyte for
    each layout. Here the stream is disconnected.
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
    """Write the remaining data within the time limit, close everything, and return whether all was written."""
    taken = True
    try:
        stream.flush(timeout_sec=FLUSH_SECONDS)
    except RuntimeError as error:
        structlog.get_logger("recorder").warning("the file or the viewer does not take the view", why=str(error))
        taken = False
    stream.disconnect()
    return taken


def release_streams() -> None:
    """Release Rerun's resources of streams without a reference: two threads and some megabytes each.

    Rerun does so only in `rr.init`, which a process with several streams never calls.
    """
    # A stream is part of reference cycles, and Rerun releases only collected streams.
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
