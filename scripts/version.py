"""Common version of all distributions: the last tag of git, or a development version without a tag.

Hatchling runs `version()` when it builds a distribution from this repository (`[tool.hatch.version]`); `make dist`
writes the same version into the sources that it packs, so that an sdist needs neither git nor this file.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NEXT = (0, 1, 0)
"""Next release, for a source without a tag; increase it when that release is tagged."""

_RELEASE = re.compile(r"v?(\d+)\.(\d+)\.(\d+)((?:a|b|rc)\d+)?")


def version() -> str:
    """Return the version: `DURALAB_VERSION` if it is set, that of git, or `NEXT` as a development version.

    A tagged commit without changes is `1.2.3`. Commits behind a tag are development versions of the release after it,
    `1.2.4.dev7+g0a1b2c3`, with the number of commits since the tag.

    Raises
    ------
    ValueError
        `DURALAB_VERSION` or the tag is not a version.
    """
    if given := os.environ.get("DURALAB_VERSION"):
        if not re.fullmatch(r"\d+\.\d+\.\d+((a|b|rc)\d+)?(\.dev\d+)?(\+[a-z0-9.]+)?", given):
            raise ValueError(f"DURALAB_VERSION is {given!r}; give a version such as 1.2.3 or 1.2.3rc1, or unset it.")
        return given
    # A copy without .git inside another repository must not take that repository's version.
    if not (ROOT / ".git").exists():
        return f"{_text(NEXT)}.dev0"
    described = _git("describe", "--tags", "--long", "--dirty", "--match", "v[0-9]*")
    if described is None:
        count, commit = _git("rev-list", "--count", "HEAD"), _git("rev-parse", "--short=7", "HEAD")
        return f"{_text(NEXT)}.dev{count}+g{commit}" if count and commit else f"{_text(NEXT)}.dev0"
    return version_of_description(described)


def version_of_description(described: str) -> str:
    """Return the version from the output of `git describe --long --dirty`, e.g. `v1.2.3-7-g0a1b2c3-dirty`."""
    text, dirty = described.removesuffix("-dirty"), described.endswith("-dirty")
    tag, count, commit = text.rsplit("-", 2)
    found = _RELEASE.fullmatch(tag)
    if found is None:
        raise ValueError(f"The tag {tag!r} is not a version; a release's tag is v1.2.3 or v1.2.3rc1.")
    release = (int(found[1]), int(found[2]), int(found[3]))
    candidate = found[4] or ""
    if count == "0" and not dirty:
        return _text(release) + candidate
    # A development version comes before its release, so it is named after the next candidate or the next release.
    if candidate:
        letters = candidate.rstrip("0123456789")
        following = f"{_text(release)}{letters}{int(candidate[len(letters) :]) + 1}"
    else:
        following = _text((release[0], release[1], release[2] + 1))
    return f"{following}.dev{count}+{commit}" + (".dirty" if dirty else "")


def _text(release: tuple[int, int, int]) -> str:
    return ".".join(str(part) for part in release)


def _git(*arguments: str) -> str | None:
    """Return git's output; None if git is not installed or fails."""
    try:
        done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=False)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


if __name__ == "__main__":
    sys.stdout.write(version() + "\n")
