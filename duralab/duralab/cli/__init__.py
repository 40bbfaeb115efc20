"""The command line; only what a command needs is imported when it runs."""

from __future__ import annotations

import sys
from io import TextIOWrapper


def main() -> None:
    """Run the command line."""
    from duralab.python_version import python_fault

    # Before anything is imported that an older Python cannot even read.
    if (fault := python_fault(sys.version_info[:3])) is not None:
        sys.exit(f"Error: {fault[:-1]}; install one, and make the environment with it.")
    from duralab.cli.application import app

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # A terminal that has no ★ shows a question mark; a table is no reason for a traceback.
            stream.reconfigure(errors="replace")
    app()
