"""What a fence says besides its language, made readable: the name of a file, an exit code, why it is not run."""

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
    """Return a page with what its fences are told turned into titles, which a reader sees.

    Parameters
    ----------
    markdown : str
        With fences as `tests/documented.py` reads them.

    Returns
    -------
    str
        With fences as `pymdownx.superfences` reads them.
    """
    return _FENCE.sub(_titled, markdown)


def _titled(match: re.Match[str]) -> str:
    titles = [title.format(found[1]) for pattern, title in _TITLES if (found := pattern.search(match["told"]))]
    title = f' title="{"; ".join(titles)}"' if titles else ""
    return f"{match['fence']}{match['language']}{title}"
