"""Check CHANGELOG.md: its form, and that a branch with user-visible changes adds a note (`make check-changelog`).

A commit without a user-visible change has the line `Changelog: none` in its message.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from datetime import date
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
KINDS: Final = ("Added", "Changed", "Deprecated", "Removed", "Fixed", "Security")
NO_NOTE: Final = "Changelog: none"
_HEADING: Final = re.compile(r"## \[(?P<version>[^\]]+)\](?: - (?P<date>\S+))?")
_VERSION: Final = re.compile(r"\d+\.\d+\.\d+(?:(?:a|b|rc)\d+)?")
# Installed and shipped files; tests and READMEs in these folders are excluded.
_SEEN_BY_USERS: Final = re.compile(
    r"(?:duralab/duralab|libs/[a-z_]+/duralab_|services/[a-z_]+/[a-z_]+|proto/duralab)[^:]*"
)
_INSIDE: Final = re.compile(r"/(?:tests|__pycache__)/|\.md$|^services/[a-z_]+/tests/")


def faults(text: str) -> list[str]:
    """Return a sentence for each error in the form of a changelog."""
    found = []
    sections: list[str] = []
    dates: list[str] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("## "):
            heading = _HEADING.fullmatch(line)
            if heading is None:
                found.append(f"Line {number} is {line!r}; write `## [Unreleased]` or `## [1.2.3] - 2026-11-30`.")
                continue
            sections.append(heading["version"])
            if heading["version"] != "Unreleased":
                found += _release_faults(number, heading["version"], heading["date"])
                dates.append(heading["date"] or "")
        elif line.startswith("### ") and line[4:] not in KINDS:
            found.append(f"Line {number} has the kind {line[4:]!r}; use one of {', '.join(KINDS)}.")
    if sections[:1] != ["Unreleased"]:
        found.append("The first section is not `## [Unreleased]`; put it above the releases.")
    if twice := sorted({section for section in sections if sections.count(section) > 1}):
        found.append(f"{', '.join(twice)} has more than one section; join them.")
    if dates != sorted(dates, reverse=True):
        found.append("The releases are not in order; put the newest first.")
    return found


def _release_faults(number: int, version: str, day: str | None) -> list[str]:
    found = []
    if _VERSION.fullmatch(version) is None:
        found.append(f"Line {number} has the version {version!r}; write one such as 1.2.3 or 1.2.3rc1.")
    try:
        date.fromisoformat(day or "")
    except ValueError:
        found.append(f"Line {number} has the date {day!r}; write one such as 2026-11-30.")
    return found


def needs_note(path: str) -> bool:
    """Return whether a change of this file may be noticed by a user."""
    return _SEEN_BY_USERS.match(path) is not None and _INSIDE.search(path) is None


def commits_without_note(base: str, *, root: Path = ROOT) -> list[str]:
    """Return the user-visible commits of a branch since `base`, if the changelog is unchanged.

    Parameters
    ----------
    base : str
        Branch or commit that the changes go into.
    root : Path
        The repository.

    Returns
    -------
    list of str
        Short hash and first line of each; empty if the changelog is changed, or each commit says `Changelog: none`.
    """
    since = _git(root, "merge-base", base, "HEAD").strip()
    if "CHANGELOG.md" in _git(root, "diff", "--name-only", since).splitlines():
        return []
    found = []
    for commit in _git(root, "rev-list", "--no-merges", f"{since}..HEAD").split():
        message = _git(root, "log", "-1", "--format=%B", commit)
        changed = _git(root, "diff-tree", "--no-commit-id", "--name-only", "-r", commit).splitlines()
        if NO_NOTE not in message.splitlines() and any(map(needs_note, changed)):
            found.append(_git(root, "log", "-1", "--format=%h %s", commit).strip())
    return found


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "-C", str(root), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def main() -> int:
    """Check both; BASE names the branch that the changes go into."""
    found = faults((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    base = os.environ.get("BASE") or "main"
    try:
        missing = commits_without_note(base)
    except (OSError, subprocess.CalledProcessError):
        sys.stdout.write(f"There is no branch {base!r} here: only the form of CHANGELOG.md was checked (BASE=...).\n")
        missing = []
    if missing:
        found.append(
            f"{len(missing)} commits since {base} change what users see and CHANGELOG.md has no note: "
            f"{'; '.join(missing)}; add one under [Unreleased], or the line `{NO_NOTE}` to each message."
        )
    for sentence in found:
        sys.stderr.write(f"CHANGELOG.md: {sentence}\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
