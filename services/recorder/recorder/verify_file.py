"""Check of a recording outside a recorder's folder: `python -m recorder.verify_file RECORDING.mcap`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from itertools import count
from pathlib import Path

from recorder.reading import audit


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the findings of a recording as a JSON list of sentences; return 1 if it cannot be read at all."""
    parser = argparse.ArgumentParser(description="Read a recording from end to end and report each error in it.")
    parser.add_argument("file", type=Path, help="its first file; those that follow lie beside it")
    first = parser.parse_args(arguments).file
    try:
        findings = audit([first, *_following(first)]).findings
    except OSError as error:
        sys.stderr.write(f"The recording {first} cannot be read: {error.strerror or error}.\n")
        return 1
    json.dump(findings, sys.stdout)
    return 0


def _following(first: Path) -> list[Path]:
    found: list[Path] = []
    for number in count(2):
        path = first.with_name(f"{first.stem}.part{number:02d}{first.suffix}")
        if not path.is_file():
            return found
        found.append(path)
    raise AssertionError


if __name__ == "__main__":
    sys.exit(main())
