"""Machine code of compiled models on disk, so that a rig that was compiled before starts at once.

The name of a file is a hash of all that determines the code: the caller's key, the sources of this package, the
compiler and the processor. Code from a file is proven against Drake like any other code, at every load. What Drake
read for a rig's view is kept in the same way.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import structlog
from llvmlite import binding as llvm

from rig_sim.compile.compiled_model import CompiledModel, CompiledModule, compile_module, link_module
from rig_sim.compile.constants import ConstantTable

FOLDER_VARIABLE: Final = "DURALAB_CODE_CACHE"
"""Environment variable with another folder for the code; `off` disables the cache."""

MOST_FILES: Final = 256
"""Largest number of files; beyond it the least recently used are deleted.

A rig has two of 300 kB, as a structure, and a small one.
"""

_SUFFIX: Final = ".code"
_COMPILERS: Final = ("llvmlite", "numpy", "drake")


def cached_model(key: str, compile_it: Callable[[], CompiledModel]) -> CompiledModel:
    """Return the model of a key: from the cache of this machine, or compiled and stored.

    `key`: Differs if anything in the model differs. An error in reading or writing the code is
    logged, and the model is compiled.
    """
    return _kept(
        key,
        compile_it,
        link=lambda code, described: _linked(code, described, np.array(described["constants"], dtype=float)),
        describe=lambda model: _described(model) | {"constants": model.constants.tolist()},
    )


def shared_model(said: str, table: ConstantTable, compile_it: Callable[[], CompiledModel]) -> CompiledModel:
    """Return a model from the code of any model of its structure, with its own constants.

    `said`: Parameters of the code, in addition to the table's structure. If there is no
    code yet, the model is compiled; code with a number computed from its constants is not stored for other models.
    """

    def linked(code: bytes, described: dict[str, Any]) -> CompiledModel:
        return _linked(code, described, table.content(described["entries"]))

    return _kept(
        f"structure {table.structure} {said}",
        compile_it,
        link=linked,
        describe=lambda model: _described(model) | {"entries": table.entries} if table.complete else None,
    )


@cache
def _generator() -> str:
    """Return the SHA-256 of the sources of this package, which generate the code."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


def cached_module(text: str) -> CompiledModule:
    """Return the machine code of a module's text, cached as that of models."""
    return _kept(text, lambda: compile_module(text), link=lambda code, _: link_module(code), describe=lambda _: {})


def cached_bytes(key: str, make: Callable[[], bytes]) -> bytes:
    """Return the bytes of a key: from the cache of this machine, or made and stored."""
    return _kept(key, lambda: _Bytes(make()), link=lambda code, _: _Bytes(code), describe=lambda _: {}).code


@dataclass(frozen=True)
class _Bytes:
    """Content of a file that is no machine code."""

    code: bytes


_Made = TypeVar("_Made", CompiledModel, CompiledModule, _Bytes)


def _kept(
    key: str,
    make: Callable[[], _Made],
    *,
    link: Callable[[bytes, dict[str, Any]], _Made],
    describe: Callable[[_Made], dict[str, Any] | None],
) -> _Made:
    """Return the object in a key's file, or make it and store it, unless it has no description."""
    folder = _folder()
    if folder is None:
        return make()
    path = folder / f"{_digest(key)}{_SUFFIX}"
    found = _read(path, link)
    if found is not None:
        return found
    made = make()
    if (described := describe(made)) is not None:
        _write(path, made.code, described)
    return made


def _folder() -> Path | None:
    given = os.environ.get(FOLDER_VARIABLE)
    if given:
        return None if given == "off" else Path(given)
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "duralab" / "code"
    except RuntimeError:  # A user without a home.
        return None


def _digest(key: str) -> str:
    return hashlib.sha256("\n".join([key, _generator(), *_machine()]).encode()).hexdigest()


@cache
def _machine() -> tuple[str, ...]:
    """Return what else determines the code: Python, the compilers and the processor."""
    made_with = [f"{name} {version(name)}" for name in _COMPILERS]
    processor = [llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()]
    return (sys.version, *made_with, *processor)


def _read(path: Path, link: Callable[[bytes, dict[str, Any]], _Made]) -> _Made | None:
    try:
        with path.open("rb") as stream:
            # Code that another user could have written is not executed.
            if not (_is_own(os.fstat(stream.fileno())) and _is_own(path.parent.stat())):
                _say("Compiled code is not used: others may write to its folder.", path)
                return None
            head, code = stream.readline(), stream.read()
        described = json.loads(head)
        if hashlib.sha256(code).hexdigest() != described.pop("code_hash"):
            raise ValueError("its hash is another")
        model = link(code, described)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
        _say("Compiled code is not used.", path, why=f"{type(error).__name__}: {error}")
        return None
    with suppress(OSError):
        os.utime(path)
    return model


def _linked(code: bytes, described: dict[str, Any], constants: np.ndarray) -> CompiledModel:
    order = described["state_order"]
    return CompiledModel(
        link_module(code),
        constants,
        state_names=tuple(described["state_names"]),
        input_names=tuple(described["input_names"]),
        output_names=tuple(described["output_names"]),
        operation_count=int(described["operation_count"]),
        state_order=None if order is None else tuple(order),
    )


def _described(model: CompiledModel) -> dict[str, Any]:
    return {
        "state_names": model.state_names,
        "input_names": model.input_names,
        "output_names": model.output_names,
        "operation_count": model.operation_count,
        "state_order": model.state_order,
    }


def _write(path: Path, code: bytes, described: dict[str, Any]) -> None:
    head = {"code_hash": hashlib.sha256(code).hexdigest(), **described}
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.part")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        try:
            with open(temporary, "xb", opener=_private) as stream:
                stream.write(json.dumps(head).encode() + b"\n" + code)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
        _delete_oldest(path.parent)
    except OSError as error:
        _say("Compiled code is not kept.", path, why=error.strerror or str(error))


def _private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def _delete_oldest(folder: Path) -> None:
    def last_use(file: Path) -> float:
        with suppress(OSError):
            return file.stat().st_mtime
        return 0.0

    files = sorted(folder.glob(f"*{_SUFFIX}"), key=last_use, reverse=True)
    for file in files[MOST_FILES:]:
        with suppress(OSError):
            file.unlink()


def _is_own(status: os.stat_result) -> bool:
    return status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _say(what: str, path: Path, **more: str) -> None:
    structlog.get_logger("rig_sim").warning(what, file=str(path), **more)
