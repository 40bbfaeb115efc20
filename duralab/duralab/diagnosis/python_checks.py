"""Whether it is the right Python, with the whole lab in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from duralab.diagnosis.finding import Finding, fine, problem, warning
from duralab.lab import SERVICES
from duralab.python_version import python_fault

_POINTER_BITS: Final = 64


def check_python(version: tuple[int, ...], *, pointer_bits: int, executable: str) -> Finding:
    """Judge the Python that runs this and will run the services."""
    if (fault := python_fault(version)) is not None:
        return problem("Python", f"{executable}: {fault}", "Install one, and make the environment with it.")
    if pointer_bits != _POINTER_BITS:
        return problem(
            "Python",
            f"{executable} is a Python of {pointer_bits} bits; the rigs need one of {_POINTER_BITS}.",
            "Install a 64-bit Python and make the environment with it.",
        )
    return fine("Python", f"{'.'.join(str(part) for part in version)} at {executable}")


def check_services(is_installed: Callable[[str], bool], *, executable: str) -> Finding:
    """Judge whether this Python can start every service; `is_installed` tells it of a module."""
    missing = [name for name in SERVICES if not is_installed(name)]
    if missing:
        return problem(
            "services",
            f"{executable} has no {', '.join(missing)}: `duralab up` starts its services with this Python.",
            "Use the Python of the environment that has the whole lab (`make setup` makes .venv), or install it there.",
        )
    return fine("services", f"{', '.join(SERVICES)} are installed")


def check_shadows(folder: Path, *, paths: Sequence[str]) -> Finding:
    """Judge whether a file here, or on PYTHONPATH, would be taken for a service of the same name."""
    places = [folder, *(Path(path) for path in paths if path)]
    found = [
        shadow
        for place in places
        for name in SERVICES
        for shadow in (place / f"{name}.py", place / name / "__init__.py")
        if shadow.is_file()
    ]
    if found:
        return problem(
            "names",
            f"{', '.join(str(path) for path in found)} would be started instead of the service of that name.",
            "Rename it, or run duralab in another folder and with PYTHONPATH unset.",
        )
    return fine("names", "nothing here hides a service")


def check_command(found: str | None, *, prefix: Path) -> Finding:
    """Judge whether the command `duralab` that a shell finds belongs to the Python at `prefix`."""
    if found is None:
        return warning(
            "command",
            "A shell does not find `duralab`.",
            f"Activate the environment, or type {prefix / 'bin' / 'duralab'}.",
        )
    if not Path(found).absolute().is_relative_to(prefix.absolute()):
        return warning(
            "command",
            f"A shell finds {found}, which belongs to another Python than {prefix}.",
            "Activate the environment that is meant, so that both are the same.",
        )
    return fine("command", found)
