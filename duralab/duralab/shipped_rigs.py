"""The rigs that the simulator on this machine ships, asked of it: whether they run or not."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Final

_SECONDS: Final = 30.0


def shipped_rigs() -> dict[str, str]:
    """Return what is mounted on each shipped rig, in words, by its name; nothing where no simulator is installed."""
    asked = [sys.executable, "-m", "rig_sim", "--list"]
    try:
        answer = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=_SECONDS).stdout
        return dict(json.loads(answer))
    except (OSError, subprocess.SubprocessError, ValueError):
        return {}
