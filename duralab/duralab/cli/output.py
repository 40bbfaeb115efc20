"""Output of a command: text, the next commands to type, and with `--json` one document on standard output."""

from __future__ import annotations

import math
import shlex
import shutil
import sys
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


class Output:
    """Standard output of a command; with `--json` the text goes to standard error instead."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json

    @cached_property
    def console(self) -> Console:
        """Console for text, tables and progress; it does not wrap lines."""
        from rich.console import Console

        return Console(soft_wrap=True, stderr=self._as_json)

    def say(self, *lines: str, style: str | None = None) -> None:
        """Print lines as they are, without markup and highlighting."""
        for line in lines:
            self.console.print(line, style=style, highlight=False, markup=False)

    def document(self, document: object, *, on_one_line: bool = False) -> bool:
        """Print the JSON document if it is asked for; return whether it is."""
        if self._as_json:
            write_json(document, on_one_line=on_one_line)
        return self._as_json


def write_json(document: object, *, on_one_line: bool = False) -> None:
    """Print a document: paths and enums become strings, nan and infinity null.

    On one line for a command that continues: its reader knows that the document is whole at the end of the line.
    """
    import json

    text = json.dumps(_plain(document), indent=None if on_one_line else 2, allow_nan=False)
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _plain(value: Any) -> Any:
    """Return a value as JSON knows it."""
    if hasattr(value, "tolist"):  # a number or an array of numpy
        value = value.tolist()
    match value:
        case dict():
            plain: Any = {str(key): _plain(item) for key, item in value.items()}
        case list() | tuple():
            plain = [_plain(item) for item in value]
        case float():
            plain = value if math.isfinite(value) else None
        case None | bool() | int():
            plain = value
        case _:
            plain = str(value)
    return plain


def own_command() -> str:
    """Return how this command line was started, so that a hint works when it is typed as it stands."""
    program = Path(sys.argv[0])
    if program.name != "duralab":
        return f"{shlex.quote(sys.executable)} -m duralab"
    found = shutil.which("duralab")
    if found is not None and Path(found).resolve() == program.resolve():
        return "duralab"
    here = Path.cwd()
    absolute = program.absolute()
    return shlex.quote(str(absolute.relative_to(here) if absolute.is_relative_to(here) else absolute))


def open_hint(path: Path) -> str:
    """Return the command that opens a file in the program the system has for it."""
    program = {"darwin": "open", "win32": "start"}.get(sys.platform, "xdg-open")
    return f"{program} {shlex.quote(str(path))}"


def page_lines(name: str, page: Path, *, pdf: Path | None) -> list[str]:
    """Return a line for a written page, and one for its PDF, with the commands that open them."""
    files = {name: page} if pdf is None else {name: page, "PDF": pdf}
    return [f"{what}: {file}   open it with:  {open_hint(file)}" for what, file in files.items()]
