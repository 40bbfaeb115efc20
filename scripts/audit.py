"""Audit the dependencies: the lock, and known vulnerabilities if a database can be reached."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib.metadata import distributions
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LOCK = ROOT / "requirements.lock"
_HASH = re.compile(r"--hash=sha256:[0-9a-f]{64}\b")
_LONGEST_SECONDS = 600.0


def locked(text: str) -> dict[str, tuple[str, int]]:
    """Return version and number of hashes of every package of a lock, by its name.

    Raises
    ------
    SystemExit
        An entry is not pinned to one version.
    """
    found: dict[str, tuple[str, int]] = {}
    for entry in re.split(r"(?m)^(?=[A-Za-z0-9])", text)[1:]:
        pinned = re.match(r"([A-Za-z0-9._-]+)==([^\s;\\]+)", entry)
        if pinned is None:
            raise SystemExit(f"requirements.lock: {entry.splitlines()[0]!r} is not pinned to one version.")
        version, hashes = found.get(_plain(pinned[1]), (pinned[2], 0))
        # A package with markers may have several versions in the lock, each with separate hashes.
        if not (count := len(_HASH.findall(entry))):
            raise SystemExit(f"requirements.lock: {pinned[0]} has no sha256; run `make lock`.")
        found[_plain(pinned[1])] = (f"{version} {pinned[2]}", hashes + count)
    return found


def differing(lock: dict[str, tuple[str, int]]) -> list[str]:
    """Return the installed packages that are not in the lock, or have another version there."""
    found = []
    for distribution in distributions():
        name = _plain(distribution.metadata["Name"])
        if name.startswith("duralab"):
            continue
        if name not in lock:
            found.append(f"{name} {distribution.version} is installed and not in the lock")
        elif distribution.version not in lock[name][0].split():
            found.append(f"{name} {distribution.version} is installed; the lock has {lock[name][0].split()[0]}")
    return sorted(found)


def known_vulnerabilities() -> list[str] | None:
    """Return the findings of pip-audit, one line each; None if its database cannot be reached."""
    command = [sys.executable, "-m", "pip_audit", "--requirement", str(LOCK), "--require-hashes", "--disable-pip"]
    try:
        done = subprocess.run(
            [*command, "--vulnerability-service", "osv", "--format", "json", "--progress-spinner", "off"],
            capture_output=True,
            text=True,
            timeout=_LONGEST_SECONDS,
            check=False,
        )
        audited = json.loads(done.stdout)["dependencies"]
    except (subprocess.TimeoutExpired, ValueError, KeyError):
        return None
    # A skipped package was not looked up, so the result is incomplete.
    if any("skip_reason" in package for package in audited):
        return None
    return [
        f"{package['name']} {package['version']}: {finding['id']}, mended in {finding['fix_versions'] or 'none yet'}"
        for package in audited
        for finding in package["vulns"]
    ]


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def main() -> int:
    """Audit, and print the checks and their findings."""
    lock = locked(LOCK.read_text(encoding="utf-8"))
    wrong = differing(lock)
    for line in wrong:
        sys.stderr.write(f"{line}.\n")
    hashes = sum(count for _, count in lock.values())
    sys.stdout.write(
        f"requirements.lock pins {len(lock)} packages, every one with its sha256 ({hashes} in all); "
        f"{'what is installed is what it pins' if not wrong else f'{len(wrong)} differ here'}.\n"
    )
    vulnerabilities = known_vulnerabilities()
    if vulnerabilities is None:
        sys.stdout.write(
            "The database of vulnerabilities cannot be reached from here: nothing was looked up in it, "
            "only the lock was checked.\n"
        )
        vulnerabilities = []
    else:
        sys.stdout.write(f"{len(vulnerabilities)} known vulnerabilities in {len(lock)} packages.\n")
    for line in vulnerabilities:
        sys.stderr.write(f"{line}\n")
    return 1 if wrong or vulnerabilities else 0


if __name__ == "__main__":
    sys.exit(main())
