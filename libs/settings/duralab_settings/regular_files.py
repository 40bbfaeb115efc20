"""Files that a user names: only regular ones are read, because a FIFO or a device blocks its reader without end."""

from __future__ import annotations

import errno
import os
import stat
import sys
from io import BufferedReader
from pathlib import Path
from typing import Final

from duralab_settings.portable_files import OPEN_BINARY

_KINDS: Final = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def require_regular(path: Path) -> os.stat_result:
    """Return the status of a regular file, without opening it.

    Parameters
    ----------
    path : Path
        Path of the file; links are followed.

    Returns
    -------
    os.stat_result
        Status from `Path.stat`.

    Raises
    ------
    OSError
        If the file does not exist, or is a FIFO, a socket, a device or a directory; `strerror` names the reason.
    ValueError
        If no file can have this name.
    """
    return _checked(path, path.stat())


def open_regular(path: Path) -> BufferedReader:
    """Open a regular file for reading, without waiting for another process.

    Parameters
    ----------
    path : Path
        Path of the file; links are followed.

    Returns
    -------
    BufferedReader
        Stream at its first byte; the caller closes it.

    Raises
    ------
    OSError, ValueError
        As for `require_regular`, or the file may not be read.
    """
    # Checked before it is opened: opening a FIFO even briefly would disturb its writer.
    require_regular(path)
    # Checked again after opening, because another file may have got its name; O_NONBLOCK prevents a wait then. On
    # Windows no file can be a FIFO.
    without_waiting = OPEN_BINARY if sys.platform == "win32" else os.O_NONBLOCK
    descriptor = os.open(path, os.O_RDONLY | without_waiting)
    try:
        _checked(path, os.fstat(descriptor))
    except OSError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb")


def read_regular(path: Path, *, largest: int) -> bytes:
    """Return the content of a regular file.

    Parameters
    ----------
    path : Path
        Path of the file.
    largest : int
        Largest allowed size in bytes.

    Returns
    -------
    bytes
        Content of the file.

    Raises
    ------
    OSError
        As for `require_regular`, or the file is larger.
    """
    with open_regular(path) as stream:
        content = stream.read(largest + 1)
        size = max(len(content), os.fstat(stream.fileno()).st_size)
    if size > largest:
        raise OSError(errno.EFBIG, f"it has {size} bytes, and {largest} are allowed", str(path))
    return content


def _checked(path: Path, status: os.stat_result) -> os.stat_result:
    kind = stat.S_IFMT(status.st_mode)
    if kind == stat.S_IFDIR:
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if kind != stat.S_IFREG:
        said = f"it is {_KINDS.get(kind, 'no regular file')}, and only a regular file is read"
        raise OSError(errno.EINVAL, said, str(path))
    return status
