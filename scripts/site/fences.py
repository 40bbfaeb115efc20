"""Titles for the options of a fence: the name of a file, an exit code, the reason why it is not run."""

from __future__ import annotations

import re

_FENCE = re.compile(r"^(?P<fence>`{3,}|~{3,})(?P<language>[\w-]+)[ ]+(?P<told>[^`\n]+)$", flags=re.M)
_TITLES = (
    (re.compile(r"file=(\S+)"), "{}"),
    (re.compile(r"exit=(\d+)"), "ends with exit code {}"),
    (re.compile(r'not-run="([^"]+)"'), "not run by a test: {}"),
    (re.compile(r"\b(background)\b"), "goes on running: a terminal of its own"),
    (re.compile(r"output=(\S+)"), "output of {}"),
)


def with_titles(markdown: str) -> str:
    """Return a page with the options of its fences converted to visible titles.

    Parameters
    ----------
    markdown : str
        Page with fences in the form of `tests/documented.py`.

    Returns
    -------
    str
        Page with fences in the form of `pymdownx.superfences`.
    """
    return _FENCE.sub(_titled, markdown)


def _titled(match: re.Match[str]) -> str:
    titles = [title.format(found[1]) for pattern, title in _TITLES if (found := pattern.search(match["told"]))]
    title = f' title="{"; ".join(titles)}"' if titles else ""
    return f"{match['fence']}{match['language']}{title}"
