"""The rigs that the simulator on this machine ships, asked of it: whether they run or not."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Final

from duralab.errors import InputError

_SECONDS: Final = 30.0


def shipped_rigs() -> dict[str, str]:
    """Return what is mounted on each shipped rig, in words, by its name; nothing where no simulator is installed."""
    asked = [sys.executable, "-m", "rig_sim", "--list"]
    try:
        answer = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=_SECONDS).stdout
        return dict(json.loads(answer))
    except (OSError, subprocess.SubprocessError, ValueError):
        return {}


def require_shipped(rigs: Sequence[str], *, usual: Sequence[str]) -> None:
    """Check the rigs of a lab that is about to be started.

    `rigs`: Their names. `usual`: Those that every lab has, which are not asked for.
    Raises `InputError`: The simulator ships no such rig.
    """
    if set(rigs) <= set(usual):
        return
    shipped = shipped_rigs()
    unknown = [name for name in rigs if name not in shipped]
    # Without a simulator there is no list; what is wrong then, the start of the lab says.
    if shipped and unknown:
        raise InputError(
            f"There is no rig {', '.join(map(repr, unknown))} to start a lab with; there are {', '.join(shipped)}.",
            field="rig",
        )
