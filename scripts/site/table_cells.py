"""Text from code, escaped for a table of a page."""

from __future__ import annotations

import re

_CODE = re.compile(r"(`[^`]*`)")


def cell(text: str) -> str:
    """Return text as one line, with column separators and HTML escaped.

    Parameters
    ----------
    text : str
        Text of a docstring, a comment or a help text.

    Returns
    -------
    str
        Markdown.
    """
    line = " ".join(text.split()).replace("|", "\\|")
    # Within backticks nothing is HTML.
    return "".join(part if part.startswith("`") else part.replace("<", "&lt;") for part in _CODE.split(line))
