"""The commands of the command line, one file each; a command is imported when it is used."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Final

__all__ = ["SECTIONS", "command_function"]

_CERTS: Final = {f"certs {name}": f"certs:{name}" for name in ("init", "issue", "renew", "show", "router", "refusals")}
_ELSEWHERE: Final = {"import": "import_file:import_file", "router": "certs:run_router", **_CERTS}
"""Module and function of the commands that are not named like their file."""

SECTIONS: Final[dict[str, tuple[str, ...]]] = {
    "The lab": ("up", "down", "status", "view"),
    "Rigs": ("rigs", "play", "identify", "check-rig", "reset"),
    "Campaigns": ("init", "run", "resume", "stop", "sweep"),
    "Recordings": ("report", "compare", "export", "catalogue", "verify"),
    "Files": ("info", "import", "convert"),
    "This machine": ("doctor",),
    "Secured lab": ("router", *_CERTS),
}
"""Names of the commands, by the sections of the help."""


def command_function(name: str) -> Any:
    """Return the function of a command.

    `name`: One of `SECTIONS`.
    Returns: Its parameters are the command's, its docstring is the command's help.
    Raises `KeyError`: If there is no such command.
    """
    if not any(name in names for names in SECTIONS.values()):
        raise KeyError(name)
    own = name.replace("-", "_")
    module, _, function = _ELSEWHERE.get(name, f"{own}:{own}").partition(":")
    return getattr(import_module(f"{__name__}.{module}"), function)
