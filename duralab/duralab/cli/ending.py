"""How a command ends: its exit code, one sentence for an error, and nothing left behind after a signal."""

from __future__ import annotations

import errno
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

import typer

from duralab.cli.exit_codes import ExitCode
from duralab.errors import InputError, LabError
from duralab.sentences import ended


class TerminatedError(KeyboardInterrupt):
    """SIGTERM came: the way out is the same as for Ctrl-C."""


def _on_sigterm(_number: int, _frame: FrameType | None) -> NoReturn:
    # Once is enough: a second signal must not cut the clean-up short.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise TerminatedError


@contextmanager
def ended_well(*, as_json: bool = False) -> Iterator[None]:
    """Turn errors and signals into one sentence on standard error and an exit code.

    Parameters
    ----------
    as_json : bool
        Print the error on standard output as well, as a JSON document in place of the result.

    Raises
    ------
    typer.Exit
        With the code of what went wrong.
    """
    signal.signal(signal.SIGTERM, _on_sigterm)
    # A script that starts a command with & makes it deaf to SIGINT; who sends one to a lab means it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # A terminal that is closed means the same.
    signal.signal(signal.SIGHUP, _on_sigterm)
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
            raise  # whoever read the output went away: nobody is there to be told
        place = f"{error.filename}: " if error.filename else ""
        fail(f"{place}{error.strerror or error}.", ExitCode.FAILED, as_json=as_json)


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
    from rich.console import Console
    from rich.text import Text

    text = Text.assemble(("Error: ", "bold red"), sentence) if error else Text(sentence)
    Console(stderr=True, soft_wrap=True).print(text)
    if as_json:
        from duralab.cli.json_output import write_json

        write_json({"error": {"message": sentence, "field": field, "service": service, "exit_code": int(code)}})
    raise typer.Exit(int(code))
