"""The index at the end of an MCAP file: whether there is one, and whether it is what its writer wrote."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from typing import IO, Final

from mcap.opcode import Opcode

from duralab.mcap_damage import damaged

MAGIC: Final = b"\x89MCAP0\r\n"

# Opcode and length, then where the index and its offsets start; the checksum follows.
_FOOTER: Final = struct.Struct("<BQQQI")
_FOOTER_LENGTH: Final = 20
_CRC_BYTES: Final = 4
_BLOCK_BYTES: Final = 1024 * 1024


def has_index(path: Path, stream: IO[bytes]) -> bool:
    """Return whether a file was finished with an index, after a look at the checksum over it.

    A flipped bit in the index would take whole chunks out of the recording without a word.

    Parameters
    ----------
    path : Path
        The file, for what is said.
    stream : IO of bytes
        Its content.

    Returns
    -------
    bool
        False where it was never finished, or finished without an index.

    Raises
    ------
    InputError
        It was finished, and its end is damaged.
    """
    size = stream.seek(0, os.SEEK_END)
    start_of_footer = size - len(MAGIC) - _FOOTER.size
    if start_of_footer < len(MAGIC):
        return False
    stream.seek(start_of_footer)
    opcode, length, index_start, _, checksum = _FOOTER.unpack(stream.read(_FOOTER.size))
    is_footer = (opcode, length) == (Opcode.FOOTER, _FOOTER_LENGTH) and index_start <= start_of_footer
    # Without an index the checksum is over the footer alone; where it is 0, none was worked out.
    covered = range(index_start or start_of_footer, start_of_footer + _FOOTER.size - _CRC_BYTES)
    is_sound = is_footer and (checksum == 0 or _checksum(stream, covered) == checksum)
    stream.seek(start_of_footer + _FOOTER.size)
    if stream.read(len(MAGIC)) != MAGIC:
        if is_sound and checksum != 0:
            raise damaged(path, "its last eight bytes are not those of an MCAP file")
        return False
    if not is_footer:
        raise damaged(path, "the footer, which says where its index is, is none")
    if not is_sound:
        raise damaged(path, "the index at its end differs from its checksum")
    return index_start > 0


def _checksum(stream: IO[bytes], covered: range) -> int:
    found = 0
    stream.seek(covered.start)
    for first in range(covered.start, covered.stop, _BLOCK_BYTES):
        found = zlib.crc32(stream.read(min(_BLOCK_BYTES, covered.stop - first)), found)
    return found
