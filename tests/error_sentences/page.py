"""The page of error sentences: `python -m tests.error_sentences.page` makes every mistake and writes it again."""

from __future__ import annotations

import ast
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import yaml

from duralab import errors
from duralab.formats import FormatError
from duralab_settings import Section

from .provoking import COMMANDS, HERE, ROOT, Provocation, Provoked, needs_lab, provocations, provoke
from .shared_files import SharedFiles
from .shared_lab import shared_lab

PAGE: Final = ROOT / "docs/reference/errors.md"
_ERRORS: Final = {
    name
    for name, kind in {**vars(errors), "FormatError": FormatError}.items()
    if isinstance(kind, type) and issubclass(kind, errors.LabError)
}
_HEAD: Final = """# Error sentences

What a command says about a mistake, with the cause, the remedy and the [exit code](exit_codes.md). Each sentence
names the value that is wrong, what is allowed or what to do; on standard error `Error:` is before it. Your names,
numbers and paths stand where the examples have theirs.

A test makes every mistake on this page and writes the page: `python -m tests.error_sentences.page`.
"""


def page(said: Iterable[tuple[Provocation, Provoked]]) -> str:
    """Return the page for mistakes and what was said of each."""
    by_command: dict[str, list[str]] = {name: [] for name in ("", *COMMANDS)}
    for one, answer in said:
        by_command[one.command].append(row(one, answer))
    parts = [_HEAD]
    for command, rows in by_command.items():
        if rows:
            title = f"duralab {command}" if command else "Any command"
            head = ["| sentence | cause | remedy | exit code |", "| --- | --- | --- | ---: |"]
            parts.append("\n".join([f"## {title}", "", *head, *rows, ""]))
    return "\n".join(parts)


def row(one: Provocation, answer: Provoked) -> str:
    """Return the row of a mistake."""
    # Two backticks: sentences name commands in one.
    return f"| `` {_cell(answer.sentence)} `` | {_cell(one.cause)} | {_cell(one.remedy)} | {answer.code} |"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


class Elsewhere(Section):
    """A place that no mistake reaches: a piece of its source, why, and the test that reaches it."""

    source: str
    why: str
    test: str


def places() -> dict[tuple[str, range], str]:
    """Return the places of the SDK that raise an error which ends a command: file, lines and source."""
    found = {}
    for path in sorted((ROOT / "duralab/duralab").rglob("*.py")):
        if "testing" in path.parts:
            continue
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and ast.unparse(node.exc.func) in _ERRORS:
                lines = range(node.lineno, (node.end_lineno or node.lineno) + 1)
                source = "\n".join(text.splitlines()[lines.start - 1 : lines.stop - 1])
                found[path.relative_to(ROOT).as_posix(), lines] = source
    return found


def elsewhere() -> dict[str, list[Elsewhere]]:
    """Return the places that unit tests reach, by file."""
    table = yaml.safe_load((HERE / "by_unit_tests.yaml").read_text(encoding="utf-8"))
    return {path: [Elsewhere.model_validate(one) for one in entries] for path, entries in table.items()}


def all_said() -> list[tuple[Provocation, Provoked]]:
    """Make every mistake, at a lab where it needs one."""
    with (
        tempfile.TemporaryDirectory(prefix="duralab-errors-") as scratch,
        shared_lab(Path(scratch) / "lab") as endpoint,
    ):
        shared = SharedFiles(Path(scratch, "shared"))
        said = []
        for number, one in enumerate(provocations()):
            folder = Path(scratch, str(number))
            folder.mkdir()
            said.append((one, provoke(one, folder, shared=shared, endpoint=endpoint if needs_lab(one) else None)))
    return said


def main() -> int:
    """Write the page, and print how many of the sentences in the source were provoked."""
    said = all_said()
    PAGE.write_text(page(said), encoding="utf-8")
    raised = {place for _, answer in said for place in answer.raised_at}
    in_sdk = sum(path.startswith("duralab/duralab/") for path, _ in raised)
    counts = f"{in_sdk} of {len(places())} places of the SDK, {len(raised) - in_sdk} of the libraries"
    sys.stdout.write(f"{len(said)} mistakes: {counts}.\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
