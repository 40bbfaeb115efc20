"""Libraries of other formats: imported when they are needed, and not trusted with hostile files."""

from __future__ import annotations

import gc
import io
import logging
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from duralab.errors import InputError
from duralab.formats.errors import FormatError

LARGEST_BYTES: Final = 8 << 30
"""Most memory that the samples of a file may take as float64: a compressed file of some kB can announce any size."""


def require_library(module: str, *, extra: str) -> ModuleType:
    """Import a library that comes with an extra of duralab."""
    # A damaged file makes them log its bytes; who wants to see that gives their logger a handler.
    logger = logging.getLogger(module.partition(".")[0])
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"This format needs {module}, which is not installed; install it with: pip install 'duralab[{extra}]'."
        ) from error


class WatchedFile(io.FileIO):
    """A file that remembers where it was read last, to say so where a library fails."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "rb")
        self.place: int | None = None
        self._size = path.stat().st_size

    def readinto(self, buffer: Any, /) -> int:
        """Read into a buffer."""
        self.place = self.tell()
        return super().readinto(buffer) or 0

    def read(self, size: int | None = -1, /) -> bytes:
        """Read some bytes: never more than are there, for Python takes the memory that is asked for beforehand."""
        self.place = self.tell()
        left = max(0, self._size - self.place)
        return super().read(left if size is None or size < 0 else min(size, left)) or b""


@contextmanager
def parsing(path: Path, expected: str) -> Iterator[WatchedFile]:
    """Give a library a file to read; whatever it raises becomes one sentence with the byte it came to."""
    try:
        stream = WatchedFile(path)
    except OSError as error:
        raise FormatError(
            path, f"it cannot be read ({error.strerror or error}); correct its rights, or give another file."
        ) from error
    with stream, warnings.catch_warnings():
        # What a library finds remarkable is no business of who reads a file; what it cannot read is said below.
        warnings.simplefilter("ignore")
        try:
            yield stream
        except InputError:
            raise
        # Parsers meet damaged bytes with whatever breaks first: KeyError, struct.error, zlib.error, OverflowError …
        except Exception as error:
            said = " ".join(str(error).split())[:200]
            reason = f"{type(error).__name__}: {said}" if said else type(error).__name__
            _let_go(error)
            raise FormatError(path, f"{expected} was expected ({reason}).", offset=stream.place) from error


def require_room(path: Path, values: int) -> None:
    """Refuse a file that announces more numbers than memory is given to."""
    if values * 8 > LARGEST_BYTES:
        raise FormatError(
            path,
            f"it announces {values} numbers; {LARGEST_BYTES // 8} at most are read, so cut it into pieces.",
            offset=0,
        )


def _let_go(error: Exception) -> None:
    """Free what a library left half made, and keep its destructors' complaints off standard error.

    asammdf's destructor trips over attributes that its constructor had not come to.
    """
    usual = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        gc.collect()
    finally:
        sys.unraisablehook = usual
