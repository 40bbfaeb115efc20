"""Reading and writing of a segment at a place, and taking its room from the disk; Windows has no calls for these."""

from __future__ import annotations

import os
import sys

if sys.platform == "win32":
    import threading

    # A descriptor has one place: who moves it and reads there must not be disturbed.
    _PLACE = threading.Lock()

    def read_at(descriptor: int, size: int, offset: int) -> bytes:
        """Return up to `size` bytes from an offset on."""
        with _PLACE:
            os.lseek(descriptor, offset, os.SEEK_SET)
            return os.read(descriptor, size)

    def write_at(descriptor: int, parts: list[bytes], offset: int) -> int:
        """Write parts after one another from an offset on; return how many bytes were written."""
        with _PLACE:
            os.lseek(descriptor, offset, os.SEEK_SET)
            return os.write(descriptor, b"".join(parts))

    def allocate(descriptor: int, size: int) -> None:
        """Take the room of a new file from the disk; raise OSError where it has not as much."""
        # NTFS reserves the room of a file that becomes longer.
        os.ftruncate(descriptor, size)

else:

    def read_at(descriptor: int, size: int, offset: int) -> bytes:
        """Return up to `size` bytes from an offset on."""
        return os.pread(descriptor, size, offset)

    def write_at(descriptor: int, parts: list[bytes], offset: int) -> int:
        """Write parts after one another from an offset on; return how many bytes were written."""
        return os.pwritev(descriptor, parts, offset)

    def allocate(descriptor: int, size: int) -> None:
        """Take the room of a new file from the disk; raise OSError where it has not as much."""
        if sys.platform == "linux":
            os.posix_fallocate(descriptor, 0, size)
        else:
            os.ftruncate(descriptor, size)
