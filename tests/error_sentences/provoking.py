"""Mistakes of users: the command line and files of each, run in this process, and what the command says."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import pytest
import yaml
from pydantic import Field
from typer.testing import CliRunner

import duralab.cli.ending as ending
import duralab.processes.service_programs as service_programs
from duralab.cli.application import app
from duralab.cli.commands import SECTIONS
from duralab.cli.ending import ExitCode
from duralab_settings import Section

from .shared_files import DEFAULT_ENDPOINT, SharedFiles

HERE: Final = Path(__file__).parent
ROOT: Final = HERE.parents[1]
COMMANDS: Final = [name for names in SECTIONS.values() for name in names]


class Provocation(Section):
    """One mistake: a command line (at the shared lab where LAB stands in it), its files, and what the page says.

    `files` are written; `change` sets keys of a shared YAML file, null removes one. `value`: What the sentence must
    repeat of the mistake. `allowed`: What it must say of what is allowed, where `REMEDY` does not find that.
    """

    run: str
    value: str
    allowed: str = ""
    cause: str
    remedy: str
    files: dict[str, str] = Field(default_factory=dict)
    change: dict[str, dict[str, Any]] = Field(default_factory=dict)
    exit: int = ExitCode.USER_ERROR

    @property
    def command(self) -> str:
        """The command, without its arguments."""
        _, *words = self.run.split()
        return next(name for name in (" ".join(words[:2]), words[0], "") if name in COMMANDS or not name)


REMEDY: Final = re.compile(
    r"\b(allowed|expected|are known|must|needed|needs|give|take|leave|correct|make|start|name|add|see|write|save|keep|"
    r"design|lists?|renew|issue|end|run|say|lower|cut|shorten|divide|call|there are|did you mean|holds the keys|each|"
    r"resume|are$|names)\b|`duralab [a-z-]+"
)
"""Words that say what is allowed or what to do, after the first part of a sentence."""


@dataclass(frozen=True)
class Provoked:
    """What a command said: exit code and outputs; and the places in the source where that was raised."""

    code: int
    stdout: str
    stderr: str
    raised_at: frozenset[tuple[str, int]]

    @property
    def sentence(self) -> str:
        """The sentence, without what begins each."""
        return self.stderr.removeprefix("Error: ").rstrip("\n")


def provocations() -> list[Provocation]:
    """Return all mistakes of the tables, in the order of the commands."""
    found = [
        Provocation.model_validate(entry)
        for path in sorted((HERE / "mistakes").glob("*.yaml"))
        for entry in yaml.safe_load(path.read_text(encoding="utf-8"))
    ]
    order = ["", *COMMANDS]
    return sorted(found, key=lambda one: order.index(one.command))


def provoke(one: Provocation, folder: Path, *, shared: SharedFiles, endpoint: str | None) -> Provoked:
    """Make a mistake in an empty folder and return what the command said, with the paths and ports of a reader."""
    for name, text in one.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="latin-1" if "\xff" in text else "utf-8")
    shared.lay_into(folder, wanted=f"{one.run} {' '.join(one.files.values())}", changes=one.change)
    _, *words = shlex.split(one.run.replace("LAB", endpoint or "LAB"))
    with _working_in(folder), _raising_noted() as raised:
        done = CliRunner().invoke(app, words)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    stderr = done.stderr.replace(f"{folder}{os.sep}", "").replace(str(folder), ".")
    # The day on which a certificate expires.
    stderr = re.sub(r"until \d{4}-\d\d-\d\d", "until …", stderr)
    if endpoint is not None:
        stderr = stderr.replace(endpoint, DEFAULT_ENDPOINT)
    return Provoked(done.exit_code, done.stdout, stderr, frozenset(raised))


def needs_lab(one: Provocation) -> bool:
    """Whether a mistake is made at the shared lab."""
    return re.search(r"\bLAB\b", one.run) is not None


@contextmanager
def _working_in(folder: Path) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name in ("XDG_STATE_HOME", "XDG_RUNTIME_DIR", "XDG_CACHE_HOME"):
            patch.setenv(name, str(folder / ".state"))
        # The simulator is asked in a process of its own, which takes seconds.
        patch.setattr(service_programs, "shipped_rigs", _shipped_rigs)
        yield


_shipped_rigs = cache(service_programs.shipped_rigs)


@contextmanager
def _raising_noted() -> Iterator[set[tuple[str, int]]]:
    """Note where each error was raised that ends a command, and those that it was made from."""
    places: set[tuple[str, int]] = set()
    original = ending.fail

    def noting(*arguments: Any, **options: Any) -> None:
        error = sys.exc_info()[1]
        while error is not None:
            if (place := _place(error.__traceback__)) is not None:
                places.add(place)
            error = error.__cause__ or error.__context__
        original(*arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ending, "fail", noting)
        yield places


def _place(traceback: TracebackType | None) -> tuple[str, int] | None:
    """Return file and line of the innermost frame."""
    place = None
    while traceback is not None:
        path = Path(traceback.tb_frame.f_code.co_filename)
        place = (path.relative_to(ROOT).as_posix(), traceback.tb_lineno) if path.is_relative_to(ROOT) else None
        traceback = traceback.tb_next
    return place
