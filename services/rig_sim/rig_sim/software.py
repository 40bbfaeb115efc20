"""What this simulator is made of: part of every rig's content hash, so that no change of the equations is forgotten."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path


@cache
def software_hash() -> str:
    """Return the SHA-256 of this package's own sources; any change of them may change what a rig answers."""
    folder = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(f"{path.relative_to(folder).as_posix()}\n".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
