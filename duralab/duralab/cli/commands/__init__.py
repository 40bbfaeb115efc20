"""The commands of the command line; a command is imported when it is used."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Final

__all__ = ["SECTIONS", "command_function"]

_CERTS: Final = tuple(f"certs {name}" for name in ("init", "issue", "renew", "show", "router", "refusals"))
_ENDURANCE: Final = (
    *(f"endurance {name}" for name in ("start", "status", "hold", "decide", "resume", "stop")),
    *("schedule design", "schedule show"),
)

SECTIONS: Final[dict[str, tuple[str, ...]]] = {
    "The lab": ("up", "down", "status", "view"),
    "Rigs": ("rigs", "play", "identify", "check-rig", "pre-test", "reset"),
    "Campaigns": ("init", "run", "decide", "resume", "stop", "sweep"),
    "Endurance tests": _ENDURANCE,
    "Recordings": ("report", "compare", "export", "catalogue", "verify"),
    "Files": ("info", "import", "convert"),
    "This machine": ("doctor",),
    "Secured lab": ("router", *_CERTS),
}
"""Names of the commands, by the sections of the help."""

_PLACES: Final = {
    "down": "up:down",
    "identify": "play:identify",
    "reset": "rigs:reset",
    "resume": "run:resume",
    "stop": "run:stop",
    "compare": "report:compare",
    "verify": "catalogue:verify",
    "doctor": "check_rig:doctor",
    "import": "convert:import_file",
    "router": "certs:run_router",
    **{name: name.replace(" ", ":") for name in (*_CERTS, *_ENDURANCE)},
}
"""Module and function of the commands that are not named like their file."""


def command_function(name: str) -> Any:
    """Return the function of a command: its docstring is the help; raises KeyError if there is no such command."""
    if not any(name in names for names in SECTIONS.values()):
        raise KeyError(name)
    own = name.replace("-", "_")
    module, _, function = _PLACES.get(name, f"{own}:{own}").partition(":")
    return getattr(import_module(f"{__name__}.{module}"), function)
