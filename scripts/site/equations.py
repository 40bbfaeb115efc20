"""Equations: TeX between dollars in the pages, MathML in the site."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', flags=re.S)


def with_equations(page: str) -> str:
    """Return a page's HTML with every equation written as MathML.

    Parameters
    ----------
    page : str
        HTML with equations in the output form of `pymdownx.arithmatex`.

    Returns
    -------
    str
        HTML with `math` elements.
    """
    return _EQUATION.sub(_mathml, page)


def _mathml(match: re.Match[str]) -> str:
    return convert(html.unescape(match[3]).strip(), display="block" if match[2] == "[" else "inline")
