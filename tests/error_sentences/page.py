"""The page of error sentences: `python -m tests.error_sentences.page` makes every mistake and writes it again."""

from __future__ import annotations

import ast
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from duralab import errors
from duralab.formats import FormatError

from .provoking import COMMANDS, ROOT, Provocation, Provoked, needs_lab, provocations, provoke
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


def places() -> int:
    """Return how many places of the SDK raise an error that ends a command with a sentence."""
    found = 0
    for path in (ROOT / "duralab/duralab").rglob("*.py"):
        if "testing" not in path.parts:
            nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            raised = [node.exc.func for node in nodes if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)]
            found += sum(ast.unparse(name) in _ERRORS for name in raised)
    return found


def main() -> int:
    """Write the page, and print how many of the sentences in the source were provoked."""
    raised: set[tuple[str, int]] = set()
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
            raised |= said[-1][1].raised_at
    PAGE.write_text(page(said), encoding="utf-8")
    in_sdk = sum(path.startswith("duralab/duralab/") for path, _ in raised)
    elsewhere = len(raised) - in_sdk
    sys.stdout.write(f"{len(said)} mistakes: {in_sdk} of {places()} places of the SDK, {elsewhere} of the libraries.\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
