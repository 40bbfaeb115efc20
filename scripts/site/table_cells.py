"""Text of code, as it may stand in a table of a page."""

from __future__ import annotations

import re

_CODE = re.compile(r"(`[^`]*`)")


def cell(text: str) -> str:
    """Return text on one line in which nothing is taken for a column or for HTML.

    Parameters
    ----------
    text : str
        As it stands in a docstring, a comment or a help text.

    Returns
    -------
    str
        Markdown.
    """
    line = " ".join(text.split()).replace("|", "\\|")
    # Within backticks nothing is HTML.
    return "".join(part if part.startswith("`") else part.replace("<", "&lt;") for part in _CODE.split(line))
