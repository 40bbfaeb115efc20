"""What a point is: a hash of everything that decides its drives and responses."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from duralab_settings import open_regular

_DISTRIBUTIONS: Final = (
    "duralab",
    "duralab-gateway",
    "duralab-identifier",
    "duralab-iterator",
    "duralab-bus",
    "duralab-drive-map",
    "duralab-loads",
    "duralab-proto",
    "duralab-recorder",
    "duralab-rig-sim",
    "duralab-roads",
    "duralab-spectra",
    "duralab-settings",
    "drake",
    "llvmlite",
    "numpy",
    "scipy",
)
"""What computes drives and responses."""

DIGITS: Final = 16
"""Of a point's name: among 100,000 points two share one once in 3.7 billion sweeps."""


def installed_versions() -> Mapping[str, str]:
    """Return the versions of everything that computes drives and responses; nothing is imported for it."""
    found = {}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return MappingProxyType(found)


def point_id(
    campaign: Mapping[str, Any],
    *,
    files: Mapping[str, str],
    specimens: Mapping[str, Any],
    versions: Mapping[str, str],
) -> str:
    """Return the name of a point: the same settings with the same versions have the same, and no others."""
    content = {"campaign": campaign, "files": files, "specimens": specimens, "versions": dict(versions)}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with open_regular(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
