"""Recordings folder of a lab; a private lab's folder is deleted only if each recording was fetched."""

from __future__ import annotations

import re
import shutil
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Final

from duralab.errors import InputError
from duralab.output_files import replace_when_complete
from duralab_proto.keys import check_id
from duralab_recordings import part_path

if TYPE_CHECKING:
    from duralab.recording import Recording

RECORDINGS: Final = "recordings"
"""Name of a private lab's recordings folder, in the folder of its results."""


@dataclass(eq=False)
class RecordingsPlace:
    """Output folder of a lab's recorder, if this process knows it.

    `folder`: Recorder's folder; None if it is unknown, or always deleted at the end. `passing`: Folder that is deleted
    at the end of the lab with all its files. `goes_on`: Whether the recorder outlives this process. `is_private`:
    Whether the recorder's folder is deleted at the end of the lab, so that files of a finished recording can be linked.
    """

    folder: Path | None = None
    passing: Path | None = None
    goes_on: bool = False
    is_private: bool = False
    fetched: set[str] = field(default_factory=set)
    """Ids of campaigns whose whole recording was fetched to the user's folder."""
    copies: set[str] = field(default_factory=set)
    """Ids of campaigns whose recording is an unchanged copy."""
    _said: dict[str, str] = field(default_factory=dict)
    """Sentence about the recording's place, by campaign id."""

    def file(self, id: str) -> Path | None:
        """Return the first file of a recording in the recorder's folder; None if there is none."""
        path = None if self.folder is None else self.folder / f"{id}.mcap"
        return path if path is not None and path.is_file() else None

    def outlives(self, path: Path) -> bool:
        """Return whether a file at this path is kept after the lab has ended."""
        return self.passing is None or not path.is_relative_to(self.passing)

    def copy_in(self, recording: Recording) -> None:
        """Copy a recording into the recorder's folder, with the recorder's file names.

        It is a copy, not a link: the recorder repairs unfinished files, and the given file must stay unchanged.
        """
        id = recording.specification.id
        if self.folder is None:
            raise InputError(
                f"{recording.path} cannot be copied to the recorder of this lab, whose folder is not known here; name "
                f"{id!r} where the lab's catalogue lists it, or use a private lab (no --connect; `duralab.start`).",
                field="id",
            )
        if self.file(id) is not None:
            raise InputError(
                f"The recorder of this lab holds a recording {id!r} already; resume it by that name.", field="id"
            )
        self.copies.add(id)
        first = self.folder / f"{check_id(id)}.mcap"
        # The first file is copied last: the recorder detects the recording by it.
        for number, file in reversed([*enumerate(recording.files, start=1)]):
            with replace_when_complete(part_path(first, number)) as temporary:
                shutil.copyfile(file, temporary)

    def expect_change(self, id: str) -> bool:
        """Note that a campaign will continue in its recording; return whether that was an unchanged copy."""
        is_copy = id in self.copies
        self.copies.discard(id)
        return is_copy

    def say(self, id: str, sentence: str) -> str:
        """Store the sentence about a recording's place, for later errors that end the lab; return it."""
        self._said[id] = sentence
        return sentence

    def left(self) -> set[str]:
        """Return the ids of the recordings that only the recorder's folder holds."""
        files = self.folder.glob("*.mcap") if self.folder is not None else ()
        return {re.sub(r"\.part\d+$", "", path.stem) for path in files} - self.fetched - self.copies

    def add_notes(self, error: BaseException) -> None:
        """Add the places of recordings to an error: stored sentences, and unreported recordings."""
        message = "\n".join([str(error), *getattr(error, "__notes__", ())])
        for sentence in (*self._said.values(), *self.unsaid()):
            if sentence not in message:
                error.add_note(sentence)

    def unsaid(self) -> list[str]:
        """Return a sentence with the place of each unreported recording."""
        return [f"The recording {id!r} is in {self.file(id)}." for id in sorted(self.left() - self._said.keys())]


@contextmanager
def own_recordings(out: Path | None) -> Iterator[RecordingsPlace]:
    """Yield a new folder for the recordings of a private lab; the services must end inside the block.

    The folder is in the results folder `out`, or in a temporary one. It is deleted only if each recording in it was
    fetched whole: committed steps are kept, regardless of how a campaign ends.
    """
    parent = Path(tempfile.mkdtemp(prefix="duralab-")) if out is None else out
    folder = _new_folder(parent)
    place = RecordingsPlace(folder, passing=parent / "out" if out is None else None, is_private=True)
    try:
        yield place
        if out is None and (sentences := place.unsaid()):
            # The user does not know the temporary folder.
            warnings.warn(" ".join(sentences), stacklevel=2)
    except BaseException as error:
        place.add_notes(error)
        raise
    finally:
        if not place.left():
            shutil.rmtree(folder, ignore_errors=True)
        if place.passing is not None:
            shutil.rmtree(place.passing, ignore_errors=True)
            with suppress(OSError):
                parent.rmdir()


def _new_folder(parent: Path) -> Path:
    """Make a folder with a free name, so that recordings of an earlier lab are neither continued nor overwritten."""
    for number in count(1):
        folder = parent / (RECORDINGS if number == 1 else f"{RECORDINGS}-{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"The folder {parent} cannot be made: {error.strerror}; give another.") from error
        return folder
    raise AssertionError("Numbers do not end.")
