"""What the mcap package raises on damaged files."""

from __future__ import annotations

import struct
from typing import Final

from mcap.exceptions import McapError
from mcap.stream_reader import CRCValidationError

# Besides its own errors.
DAMAGE: Final = (McapError, CRCValidationError, EOFError, struct.error, ValueError, KeyError, IndexError, RuntimeError)
