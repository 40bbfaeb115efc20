"""Print the lab's access control as a router enforces it: `python -m tests.security`, `make security-table`.

Every cell is tried. An upper-case letter is what came through, a dot what was refused; "!" stands where the router does
not do what the table says, and makes the exit code 1.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from duralab_proto.access import Operation, permits
from duralab_proto.keys import Keys

from .access_trials import all_trials, run_trials
from .members import TRIED, secured_folder
from .secured_router import SecuredRouter, zenohd

_LETTERS = {operation: operation.value[0].upper() for operation in Operation}


def main() -> int:
    """Try every cell and print them."""
    keys = Keys()
    trials = all_trials(keys)
    expected = {trial for trial in trials if permits(trial.member, trial.operation, trial.key, keys)}
    with tempfile.TemporaryDirectory(prefix="duralab-") as name:
        folder = secured_folder(Path(name))
        with SecuredRouter(folder, log=folder / "router.log", rust_log="warn") as router:
            came = run_trials(router.endpoint, folder, expected=expected)
    lines = [f"{'key':<44} {'operation':<10}" + "".join(f"{member.common_name:>16}" for member in TRIED)]
    for key, operation in dict.fromkeys((trial.key, trial.operation) for trial in trials):
        cells = [_cell(operation, tried in came, tried in expected) for tried in _row(trials, key, operation)]
        lines.append(f"{keys.within(key):<44} {operation:<10}" + "".join(f"{cell:>16}" for cell in cells))
    wrong = came ^ expected
    lines.append(
        f"{len(trials)} tried over {zenohd() or 'a router in a Python process'}: {len(came)} came through, "
        f"{len(trials) - len(came)} were refused, {len(wrong)} are not as the table says."
    )
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if wrong else 0


def _row(trials: list, key: str, operation: Operation) -> list:
    return [trial for trial in trials if (trial.key, trial.operation) == (key, operation)]


def _cell(operation: Operation, came: bool, expected: bool) -> str:
    return "!" if came != expected else _LETTERS[operation] if came else "."


if __name__ == "__main__":
    sys.exit(main())
