"""Commands to type next: this command line, and the one that opens a file."""

from __future__ import annotations

import shlex
import shutil
import sys
from pathlib import Path


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
