"""Libraries of other formats: imported on demand, and protected against hostile files."""

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
"""Largest size of a file's samples as float64: a compressed file of a few kB can declare any size."""


def require_library(module: str, *, extra: str) -> ModuleType:
    """Import a library that comes with an extra of duralab."""
    # For a damaged file these libraries log its bytes; a user who wants this log adds a handler.
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
    """File that stores the position of the last read, for the error if a library fails."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "rb")
        self.place: int | None = None
        self._size = path.stat().st_size

    def readinto(self, buffer: Any, /) -> int:
        """Read into a buffer."""
        self.place = self.tell()
        return super().readinto(buffer) or 0

    def read(self, size: int | None = -1, /) -> bytes:
        """Read bytes, at most the rest of the file, because Python allocates the requested size beforehand."""
        self.place = self.tell()
        left = max(0, self._size - self.place)
        return super().read(left if size is None or size < 0 else min(size, left)) or b""


@contextmanager
def parsing(path: Path, expected: str) -> Iterator[WatchedFile]:
    """Yield a file for a library to read; convert any error to a sentence with the byte of the last read."""
    try:
        stream = WatchedFile(path)
    except OSError as error:
        raise FormatError(
            path, f"it cannot be read ({error.strerror or error}); correct its rights, or give another file."
        ) from error
    with stream, warnings.catch_warnings():
        # Warnings of the library are of no use to the user; errors are reported below.
        warnings.simplefilter("ignore")
        try:
            yield stream
        except InputError:
            raise
        # Parsers raise various errors for damaged bytes: KeyError, struct.error, zlib.error, OverflowError …
        except Exception as error:
            said = " ".join(str(error).split())[:200]
            reason = f"{type(error).__name__}: {said}" if said else type(error).__name__
            _let_go(error)
            raise FormatError(path, f"{expected} was expected ({reason}).", offset=stream.place) from error


def require_room(path: Path, values: int) -> None:
    """Refuse a file that declares more values than `LARGEST_BYTES` allows."""
    if values * 8 > LARGEST_BYTES:
        raise FormatError(
            path,
            f"it announces {values} numbers; {LARGEST_BYTES // 8} at most are read, so cut it into pieces.",
            offset=0,
        )


def _let_go(error: Exception) -> None:
    """Free incomplete objects of a library, and suppress the errors of their destructors on standard error.

    asammdf's destructor uses attributes that its interrupted constructor has not set.
    """
    usual = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        gc.collect()
    finally:
        sys.unraisablehook = usual
