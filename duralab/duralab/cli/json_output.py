"""What `--json` prints: one document on standard output, and everything meant for people on standard error."""

from __future__ import annotations

import json
import math
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


def write_json(document: object, *, on_one_line: bool = False) -> None:
    """Print a document.

    Parameters
    ----------
    document : object
        Of mappings, sequences, strings, numbers and None; paths and enums become strings, nan and infinity null.
    on_one_line : bool
        For a command that goes on: whoever reads it knows that the document is whole at the end of the line.
    """
    text = json.dumps(_plain(document), indent=None if on_one_line else 2, allow_nan=False)
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def console_beside(as_json: bool) -> Console:
    """Return where a command talks to people: standard output, unless a JSON document goes there."""
    from rich.console import Console

    return Console(soft_wrap=True, stderr=as_json)


def _plain(value: Any) -> Any:
    """Return a value as JSON knows it."""
    if hasattr(value, "tolist"):  # a number or an array of numpy
        value = value.tolist()
    match value:
        case dict():
            plain: Any = {str(key): _plain(item) for key, item in value.items()}
        case list() | tuple():
            plain = [_plain(item) for item in value]
        case float():
            plain = value if math.isfinite(value) else None
        case None | bool() | int():
            plain = value
        case _:
            plain = str(value)
    return plain
