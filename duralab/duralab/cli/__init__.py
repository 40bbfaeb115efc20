"""The command line; only what a command needs is imported when it runs."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from io import TextIOWrapper
from typing import Final

_OUTPUT_CLOSED: Final = 141
"""`ExitCode.OUTPUT_CLOSED`, without its imports."""


def main() -> None:
    """Run the command line."""
    from duralab.python_version import python_fault

    code: str | int | None = None

    def leave() -> None:
        nonlocal code
        if not isinstance(code, int):
            return  # An unforeseen error: Python ends with a traceback and its own code.
        # Everything is closed and written. The interpreter's normal end can abort while a thread still imports a module
        # or a native library waits for Python's lock, and its search for garbage takes up to a third of a second.
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):
                try:
                    stream.flush()
                except BrokenPipeError:
                    # Only now was it written, and its reader, e.g. `head`, is gone.
                    code = code or _OUTPUT_CLOSED
        os._exit(code)

    # Imports leave next to no garbage, for which Python would look more than a hundred times until a lab is up.
    gc.set_threshold(100_000)
    # Before all imports: what is registered first is called last.
    atexit.register(leave)
    # Before anything is imported that an older Python cannot even read.
    if (fault := python_fault(sys.version_info[:3])) is not None:
        sys.exit(f"Error: {fault[:-1]}; install one, and make the environment with it.")
    # pydantic would read the metadata of all installed packages in search of plug-ins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # As in the services: with several BLAS threads on busy cores, writing a report took three times as long.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    _import_ahead(sys.argv[1:])
    from duralab.cli.application import app

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # A terminal that has no ★ shows a question mark; a table is no reason for a traceback.
            stream.reconfigure(errors="replace")
    try:
        app()
    except SystemExit as ended:
        code = ended.code
        raise


def _import_ahead(arguments: list[str]) -> None:
    """Begin with the imports of a private lab's services before this process makes its own."""
    wants_lab = arguments[:1] in (["run"], ["up"])
    if wants_lab and not any(argument == "--help" or argument.startswith("--connect") for argument in arguments):
        from duralab.processes import import_ahead

        import_ahead()
