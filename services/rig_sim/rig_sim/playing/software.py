"""Software of a simulated rig: part of its content hash, so that every change of the equations changes the hash."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from pathlib import Path

from pydantic import BaseModel

_PACKAGE = "rig_sim"
#: Module of the ramps and the blocks of a playback.
_MOTION = "duralab_gateway.motion"
_OWN_IMPORT = re.compile(rf"^[ ]*from (?:{_PACKAGE}|{_MOTION})(?:\.\w+)* import (?:\(([^)]*)\)|(.*))\n", re.MULTILINE)
_OWN_MODULE = re.compile(rf"\b{_PACKAGE}\.(?:\w+\.)*(?=\w)")


@cache
def software_hash() -> str:
    """Return the SHA-256 of the sources that play a rig; any change of them may change its response.

    The path of a module does not count: a moved module leaves every rig's content hash unchanged.
    """
    return sources_hash(Path(str(files(_PACKAGE))), Path(str(files(_MOTION))))


def content_hash(files: Iterable[Path], faults: Iterable[BaseModel], *, engine: str = "") -> str:
    """Return the SHA-256 of everything that determines a rig's response: software, engine, files and faults."""
    digest = hashlib.sha256(f"software {software_hash()}\n{engine}".encode())
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    for fault in faults:
        digest.update(fault.model_dump_json().encode())
    return digest.hexdigest()


def sources_hash(*folders: Path) -> str:
    """Return the SHA-256 of the modules in folders, from their content and imported names, not their paths."""
    modules = [_module_hash(path) for folder in folders for path in folder.rglob("*.py") if path.name != "__init__.py"]
    return hashlib.sha256("\n".join(sorted(modules)).encode()).hexdigest()


def _module_hash(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    names = {name.strip() for pair in _OWN_IMPORT.findall(text) for name in "".join(pair).split(",") if name.strip()}
    said = _OWN_MODULE.sub("", _OWN_IMPORT.sub("", text))
    return hashlib.sha256(f"{' '.join(sorted(names))}\n{said}".encode()).hexdigest()
