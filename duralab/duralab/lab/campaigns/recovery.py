"""What was committed to a campaign that did not end well: brought to its user, or told where it is."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from duralab.errors import LabError, ended
from duralab.lab.campaigns.fetching import fetch_files, wait_until_closed
from duralab.lab.campaigns.recordings_folder import RecordingsPlace
from duralab.lab.client import LabClient
from duralab.output_files import OUTPUTS
from duralab_bus import BusError, FaultError
from duralab_proto.keys import MAIN_INSTANCE
from duralab_proto.v1 import query_pb2

RESCUE_SECONDS: Final = 10.0
"""Longest wait for a campaign that was stopped to close its recording; then it is left where it is."""

_PLAYED: Final = "What was played until then"

LabErrorT = TypeVar("LabErrorT", bound=LabError)


@dataclass(frozen=True)
class Recovery:
    """What becomes of the recording of one campaign that ends badly.

    `ask`: The session. `id`: The campaign. `folder`: Where its outputs are to go. `place`: Where the recorder writes.
    """

    ask: LabClient
    id: str
    folder: Path
    place: RecordingsPlace

    def told(self, error: LabErrorT, *, played: bool) -> LabErrorT:
        """Bring what was committed to its user, and return the error with where it is.

        `error`: Why the campaign ended. `played`: Whether a playback was completed: without one there is nothing to
        report.
        Returns: The same error, with a note.
        """
        return _with(error, self._brought(played=played))

    def named(self, error: LabErrorT) -> LabErrorT:
        """Return the error of a finished campaign that could not be fetched, with where its recording lies.

        `error`: Why the recording could not be fetched.
        Returns: The same error, with a note.
        """
        return _with(error, self._where_it_lies(played=True))

    def note(self, interrupt: KeyboardInterrupt, *, played: bool) -> None:
        """Bring what was committed to its user, and note in the interrupt where it is.

        `interrupt`: The interrupt. `played`: Whether a playback was completed.
        """
        if sentence := self._brought(played=played):
            interrupt.add_note(sentence)

    def note_where_it_lies(self, interrupt: KeyboardInterrupt, *, played: bool) -> None:
        """Note where it is in the interrupt of somebody who does not want to wait.

        `interrupt`: The interrupt. `played`: Whether a playback was completed.
        """
        if sentence := self._where_it_lies(played=played):
            interrupt.add_note(sentence)

    def _brought(self, *, played: bool) -> str:
        try:
            if self._will_be_closed() and self._may_be_fetched():
                information = wait_until_closed(self.ask.bus, self.id, seconds=RESCUE_SECONDS)
                # With holes too: this one proves nothing, it shows what happened.
                path, _ = fetch_files(self.ask.bus, information, folder=self.folder)
                self.place.fetched(self.id)
                further = (
                    f" The lab keeps it, too: {self._resume} continues it." if played and self.place.goes_on else ""
                )
                return self.place.say(self.id, f"{_PLAYED} is in {path}; {_reader(played=played)}{further}")
        except KeyboardInterrupt as again:
            self.note_where_it_lies(again, played=played)
            raise
        except FaultError as fault:
            if fault.code == query_pb2.FAULT_CODE_NOT_FOUND and self.place.file(self.id) is None:
                return ""
        except (LabError, BusError):
            pass  # Said by where it lies instead of where it was to go; why the campaign ended is more important.
        return self._where_it_lies(played=played)

    def _where_it_lies(self, *, played: bool) -> str:
        if (path := self.place.file(self.id)) is not None:
            further = f" `duralab resume {shlex.quote(str(path))}` continues it." if played else ""
            return self.place.say(self.id, f"{_PLAYED} is in {path}; {_reader(played=played)}{further}")
        if self.place.goes_on:
            further = f"; {self._resume} continues it" if played else ""
            return f"{_PLAYED} stays with the recorder of the lab as {self.id!r}{further}."
        return ""

    @property
    def _resume(self) -> str:
        return f"`duralab resume {self.id}`"

    def _will_be_closed(self) -> bool:
        """Return whether somebody is there who closes the recording, and somebody to ask for it."""
        needed, failure = {"iterator", "recorder"}, self.ask.failure()
        if failure is not None and failure.service in needed:
            return False
        return {(service, MAIN_INSTANCE) for service in needed} <= self.ask.bus.live()

    def _may_be_fetched(self) -> bool:
        """Return whether it would be there at the end, and take the place of nothing of a better one."""
        return self.place.outlives(self.folder) and not any((self.folder / name).exists() for name in OUTPUTS)


def _reader(*, played: bool) -> str:
    return "`duralab report` shows it." if played else "`duralab.open` reads it."


def _with(error: LabErrorT, sentence: str) -> LabErrorT:
    if not sentence:
        return error
    return type(error)(f"{ended(error.message)} {sentence}", field=error.field, service=error.service)
