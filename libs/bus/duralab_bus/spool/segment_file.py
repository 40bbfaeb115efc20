"""Reading, writing and allocation of a segment at an offset; Windows has no calls for these."""

from __future__ import annotations

import os
import sys

if sys.platform == "win32":
    import threading

    # A descriptor has one position: moving it and reading there must not be interrupted.
    _PLACE = threading.Lock()

    def read_at(descriptor: int, size: int, offset: int) -> bytes:
        """Return up to `size` bytes from an offset."""
        with _PLACE:
            os.lseek(descriptor, offset, os.SEEK_SET)
            return os.read(descriptor, size)

    def write_at(descriptor: int, parts: list[bytes], offset: int) -> int:
        """Write parts after one another from an offset; return the number of bytes written."""
        with _PLACE:
            os.lseek(descriptor, offset, os.SEEK_SET)
            return os.write(descriptor, b"".join(parts))

    def allocate(descriptor: int, size: int) -> None:
        """Allocate a new file on the disk; raise OSError if the disk has too little room."""
        # NTFS allocates a file that becomes longer.
        os.ftruncate(descriptor, size)

else:

    def read_at(descriptor: int, size: int, offset: int) -> bytes:
        """Return up to `size` bytes from an offset."""
        return os.pread(descriptor, size, offset)

    def write_at(descriptor: int, parts: list[bytes], offset: int) -> int:
        """Write parts after one another from an offset; return the number of bytes written."""
        return os.pwritev(descriptor, parts, offset)

    def allocate(descriptor: int, size: int) -> None:
        """Allocate a new file on the disk; raise OSError if the disk has too little room."""
        if sys.platform == "linux":
            os.posix_fallocate(descriptor, 0, size)
        else:
            os.ftruncate(descriptor, size)
