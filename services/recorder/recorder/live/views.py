"""Live views of all open recordings, on a separate thread: a slow viewer delays no commit."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from concurrent.futures import TimeoutError as FutureTimeoutError
from pathlib import Path
from typing import TYPE_CHECKING, Final

import structlog
from google.protobuf.message import Message

from duralab_bus import import_in_background
from duralab_proto.v1 import iterator_pb2, rig_pb2
from recorder.format import Part, files_of, recording_path
from recorder.work_thread import WorkThread

if TYPE_CHECKING:
    from recorder.live.view import LiveView

MOST_BLOCKS_WAITING: Final = 5000
"""Largest number of waiting drawing jobs, about 70 MB; signal blocks and poses beyond it are left out of the view, not
of the log."""

CLOSE_SECONDS: Final = 10.0
"""Longest wait, in seconds, for a view when its recording is closed."""


class LiveViews:
    """Draws the data that is recorded.

    `folder`: Folder of the views' files. `files`: Whether each view is kept in a file beside its recording. `viewer`:
    Address of a running viewer.
    """

    def __init__(self, folder: Path, *, files: bool, viewer: str | None) -> None:
        self._folder = folder
        self._files = files
        self._viewer = viewer
        # None if it could not be opened: the recording continues without a view.
        self._views: dict[str, LiveView | None] = {}
        self._incomplete: set[str] = set()
        self._log = structlog.get_logger("recorder")
        self._thread = WorkThread("recorder-view")
        # Rerun is imported before the first recording, without a delay of the recorder's start.
        import_in_background("recorder.live.rebuild", _freeze_modules)

    def show_step(self, recording: str, message: Message) -> None:
        """Draw a committed step; the first of a recording opens its view."""
        self._offer(lambda: self._draw(recording, lambda view: view.show_step(message)))

    def show_status(self, recording: str, event: iterator_pb2.CampaignEvent) -> None:
        """Write the current activity of a campaign."""
        self._offer(lambda: self._draw(recording, lambda view: view.show_status(event.status)))

    def show_state(self, recording: str, state: rig_pb2.RigState) -> None:
        """Write the state of the recording's rig."""
        self._offer(lambda: self._draw(recording, lambda view: view.show_state(state)))

    def show_pose(self, recording: str, block: rig_pb2.PoseBlock) -> None:
        """Move the rig, unless the view is far behind."""
        self._offer(lambda: self._draw(recording, lambda view: view.show_pose(block)), most_waiting=MOST_BLOCKS_WAITING)

    def show_block(self, recording: str, block: rig_pb2.SignalBlock) -> None:
        """Draw a signal block, unless the view is far behind."""
        taken = self._offer(
            lambda: self._draw(recording, lambda view: view.show_block(block)), most_waiting=MOST_BLOCKS_WAITING
        )
        if not taken and recording not in self._incomplete:
            self._incomplete.add(recording)
            self._log.warning("the live view is too slow and leaves signal blocks out", recording=recording)

    def finish(self, recording: str) -> None:
        """Close the view of a recording and wait until its file is complete."""
        try:
            self._thread.call(lambda: self._close(recording)).result(CLOSE_SECONDS)
        except FutureTimeoutError:
            self._log.warning("the live view is not closed in time", recording=recording, seconds=CLOSE_SECONDS)
        except CancelledError:
            self._log.info("the live view ended with the recorder", recording=recording)

    def close(self, timeout_seconds: float) -> None:
        """Close all views."""
        for recording in list(self._views):
            self._offer(lambda name=recording: self._close(name))
        if not self._thread.close(timeout_seconds):
            self._log.warning("the live views are not closed in time", seconds=timeout_seconds)

    def _offer(self, job: Callable[[], None], *, most_waiting: int | None = None) -> bool:
        return self._thread.offer(job, most_waiting=most_waiting)

    def _draw(self, recording: str, draw: Callable[[LiveView], None]) -> None:
        if recording not in self._views:
            self._views[recording] = self._opened(recording)
        view = self._views[recording]
        if view is not None:
            draw(view)

    def _opened(self, recording: str) -> LiveView | None:
        path = recording_path(self._folder, recording, Part.LIVE) if self._files else None
        from recorder.live.view import LiveView

        try:
            # A restarted recorder continues a recording: the view begins with the content of its log.
            before = files_of(self._folder, recording) if path is not None and path.exists() else []
            view = LiveView(recording, file=path, viewer=self._viewer)
            self._show_before(view, recording, before)
            return view
        except Exception:  # noqa: BLE001 - Rerun raises what it likes; none of it may harm the recording
            self._log.exception("the live view cannot be opened", recording=recording)
            return None

    def _show_before(self, view: LiveView, recording: str, files: Sequence[Path]) -> None:
        from recorder.live.rebuild import UnreadableFileError, show_log

        try:
            show_log(view, files)
        except UnreadableFileError as error:
            # Later data is drawn all the same.
            self._log.warning("the live view lacks what is damaged in the log", recording=recording, why=str(error))

    def _close(self, recording: str) -> None:
        view = self._views.pop(recording, None)
        if view is not None:
            whole = view.close()
            del view
            if self._files and not whole:
                self._make_again(recording)
            from recorder.live.stream import release_streams

            release_streams()

    def _make_again(self, recording: str) -> None:
        """Write the view's file again from the log: after a full disk Rerun does not continue a file."""
        from recorder.live.rebuild import show_log
        from recorder.live.view import LiveView

        files = files_of(self._folder, recording)
        try:
            view = LiveView(recording, file=recording_path(self._folder, recording, Part.LIVE), viewer=None)
            show_log(view, files)
            if view.close():
                self._log.info("the live view is made again from the log", recording=recording)
        except Exception:  # noqa: BLE001 - as above; `duralab view` makes it again from the log as well
            self._log.exception("the live view cannot be made again", recording=recording)


def _freeze_modules() -> None:
    # Modules stay imported. Rerun's streams are released only by a garbage collection after every recording; without
    # the freeze it spends most of its time on ninety thousand objects of modules.
    gc.collect()
    gc.freeze()
