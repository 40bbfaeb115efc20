"""How a command ends: its exit code, one sentence for an error, and nothing left behind after a signal."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType
from typing import NoReturn

import typer

from duralab.errors import InputError, LabError


class ExitCode(IntEnum):
    """Exit codes of every command."""

    DONE = 0
    FAILED = 1
    """The lab or a campaign failed."""
    USER_ERROR = 2
    """A value or an option is not allowed."""
    NOT_REACHED = 3
    """The campaign finished and its outputs are there, but the target was not reached."""
    INTERRUPTED = 130
    TERMINATED = 143


class TerminatedError(KeyboardInterrupt):
    """SIGTERM came: the way out is the same as for Ctrl-C."""


def _on_sigterm(_number: int, _frame: FrameType | None) -> NoReturn:
    # Once is enough: a second signal must not cut the clean-up short.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise TerminatedError


@contextmanager
def ended_well() -> Iterator[None]:
    """Turn errors and signals into one sentence on standard error and an exit code."""
    signal.signal(signal.SIGTERM, _on_sigterm)
    # A script that starts a command with & makes it deaf to SIGINT; who sends one to a lab means it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # A terminal that is closed means the same.
    signal.signal(signal.SIGHUP, _on_sigterm)
    try:
        yield
    except InputError as error:
        _fail(error.message, ExitCode.USER_ERROR)
    except LabError as error:
        _fail(error.message, ExitCode.FAILED)
    except TerminatedError:
        _fail("Terminated; everything that was started is ended.", ExitCode.TERMINATED, error=False)
    except KeyboardInterrupt:
        _fail("Interrupted; everything that was started is ended.", ExitCode.INTERRUPTED, error=False)


def _fail(sentence: str, code: ExitCode, *, error: bool = True) -> NoReturn:
    from rich.console import Console
    from rich.text import Text

    text = Text.assemble(("Error: ", "bold red"), sentence) if error else Text(sentence)
    Console(stderr=True, soft_wrap=True).print(text)
    raise typer.Exit(int(code))
