"""Output of a command: text, the next commands to type, and with `--json` one document on standard output."""

from __future__ import annotations

import math
import os
import select
import shlex
import shutil
import sys
import threading
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from rich.console import Console


STANDARD_OUTPUTS: Final = (1, 2)


def leave_closed_outputs() -> None:
    """Send standard outputs whose reader ended first, e.g. `head`, to the null device: nothing writes there again."""
    to_null_device([number for number in STANDARD_OUTPUTS if _is_closed_pipe(number)])


def _is_closed_pipe(number: int) -> bool:
    if sys.platform == "win32":
        return False
    poll = select.poll()
    poll.register(number, 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))


def to_null_device(numbers: Sequence[int]) -> None:
    """Send file descriptors to the null device."""
    for number in numbers:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, number)
        os.close(null)


def console(*, stderr: bool) -> Console:
    """Return a console that does not wrap lines; if its reader is gone, it raises BrokenPipeError and falls silent."""
    from rich.console import Console

    class PipedConsole(Console):
        def on_broken_pipe(self) -> None:
            self.quiet = True
            leave_closed_outputs()
            # A thread that reports progress has no command to end.
            if threading.current_thread() is threading.main_thread():
                raise  # noqa: PLE0704  (rich calls this while it handles the error)

    return PipedConsole(soft_wrap=True, stderr=stderr)


class Output:
    """Standard output of a command; with `--json` the text goes to standard error instead."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json

    @cached_property
    def console(self) -> Console:
        """Console for text, tables and progress; it does not wrap lines."""
        return console(stderr=self._as_json)

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
