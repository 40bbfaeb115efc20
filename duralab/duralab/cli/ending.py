"""End of a command: its exit code, one sentence for an error, and nothing left behind after a signal."""

from __future__ import annotations

import errno
import os
import signal
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import IntEnum
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn

import typer

from duralab.cli.output import STANDARD_OUTPUTS, console, leave_closed_outputs, to_null_device, write_json
from duralab.errors import PROCESS_LIMIT, InputError, LabError, ended, is_process_limit


class ExitCode(IntEnum):
    """Exit code of a command."""

    DONE = 0
    FAILED = 1
    USER_ERROR = 2
    NOT_REACHED = 3
    INTERRUPTED = 130
    OUTPUT_CLOSED = 141
    TERMINATED = 143


MEANINGS: Final = {
    ExitCode.DONE: "done",
    ExitCode.FAILED: "the lab, a campaign or a check failed",
    ExitCode.USER_ERROR: "a wrong value or option",
    ExitCode.NOT_REACHED: "finished, but the target was not reached",
    ExitCode.INTERRUPTED: "interrupted",
    ExitCode.OUTPUT_CLOSED: "the reader of the output ended first",
    ExitCode.TERMINATED: "terminated",
}
"""Meaning of each exit code."""


_NOTHING_STARTED: Final = f"A process or thread of this command could not be started: {PROCESS_LIMIT}."


class TerminatedError(KeyboardInterrupt):
    """SIGTERM or SIGHUP arrived: the lab ends as after Ctrl-C."""


def _on_termination(_number: int, _frame: FrameType | None) -> NoReturn:
    # A second signal must not cut the clean-up short; a shell that is closed sends SIGHUP after the terminal's own.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if sys.platform != "win32":
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    _leave_closed_terminal()
    raise TerminatedError


def _leave_closed_terminal() -> bool:
    """Send standard outputs whose terminal was closed to the null device; return whether there were any.

    Every write to a closed terminal fails with EIO: an error message, a progress display or the flush at exit would
    replace the exit code.
    """
    closed = [number for number in STANDARD_OUTPUTS if _is_closed_terminal(number)]
    to_null_device(closed)
    return bool(closed)


def _is_closed_terminal(number: int) -> bool:
    try:
        status = os.fstat(number)
    except OSError:
        return False
    # A terminal that was closed is still a character device, but no longer answers as a terminal.
    if sys.platform == "win32":
        return False
    null = Path(os.devnull).stat().st_rdev
    return stat.S_ISCHR(status.st_mode) and status.st_rdev != null and not os.isatty(number)


@contextmanager
def ended_well(*, as_json: bool = False) -> Iterator[None]:
    """Turn errors and signals into a sentence (with `as_json` a JSON document as well) and typer.Exit with its code."""
    signal.signal(signal.SIGTERM, _on_termination)
    # A script that starts a command with & makes it deaf to SIGINT; who sends one to a lab means it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # `nohup` asks to continue after the terminal is closed.
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, _on_termination)
    try:
        yield
    except InputError as error:
        said = _with_notes(error.message, error)
        fail(said, ExitCode.USER_ERROR, as_json=as_json, field=error.field, service=error.service)
    except LabError as error:
        said = _with_notes(error.message, error)
        fail(said, ExitCode.FAILED, as_json=as_json, field=error.field, service=error.service)
    except TerminatedError as signalled:
        said = _with_notes("Terminated; everything that was started is ended.", signalled)
        _end(said, ExitCode.TERMINATED, as_json=as_json)
    except KeyboardInterrupt as interrupt:
        said = _with_notes("Interrupted; everything that was started is ended.", interrupt)
        _end(said, ExitCode.INTERRUPTED, as_json=as_json)
    except OSError as error:
        if error.errno == errno.EPIPE:
            # The reader of the output is gone, e.g. `| head`: as a tool that SIGPIPE ends, without a message.
            leave_closed_outputs()
            raise typer.Exit(int(ExitCode.OUTPUT_CLOSED)) from error
        if error.errno == errno.EIO and _leave_closed_terminal():
            raise typer.Exit(int(ExitCode.TERMINATED)) from error
        if is_process_limit(error):
            fail(_NOTHING_STARTED, ExitCode.FAILED, as_json=as_json)
        place = f"{error.filename}: " if error.filename else ""
        fail(f"{place}{error.strerror or error}.", ExitCode.FAILED, as_json=as_json)
    # Zenoh raises a PanicException of pyo3, which is not an Exception.
    except BaseException as error:
        if not is_process_limit(error):
            raise
        fail(_NOTHING_STARTED, ExitCode.FAILED, as_json=as_json)


def _with_notes(sentence: str, error: BaseException) -> str:
    """Return a sentence and, after it, where the recordings are that the lab's end noted in the error."""
    notes = getattr(error, "__notes__", ())
    return " ".join([ended(sentence), *notes]) if notes else sentence


def fail(sentence: str, code: ExitCode, *, as_json: bool, field: str = "", service: str = "") -> NoReturn:
    """Say what is wrong in one sentence and end with a code; raises typer.Exit."""
    _end(sentence, code, as_json=as_json, error=True, field=field, service=service)


def _end(
    sentence: str, code: ExitCode, *, as_json: bool, error: bool = False, field: str = "", service: str = ""
) -> NoReturn:
    from rich.text import Text

    text = Text.assemble(("Error: ", "bold red"), sentence) if error else Text(sentence)
    # The code is that of the error also where its reader is gone.
    with suppress(BrokenPipeError):
        console(stderr=True).print(text)
    if as_json:
        with suppress(BrokenPipeError):
            write_json({"error": {"message": sentence, "field": field, "service": service, "exit_code": int(code)}})
    leave_closed_outputs()
    raise typer.Exit(int(code))
