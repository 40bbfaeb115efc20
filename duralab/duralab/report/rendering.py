"""A page from its template: style, script, plotly.js and figures, all within one file that asks for nothing else."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import jinja2
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from duralab.report.drawing import Figure


def render(template: str, *, figures: Mapping[str, Figure], **values: Any) -> str:
    """Return a page as HTML.

    Parameters
    ----------
    template : str
        Name of a file of this folder.
    figures : mapping of str to Figure
        By the names that the page's plots have: kind, or kind and value joined by a hyphen.
    **values
        What the template names.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("duralab.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(
        asset=_asset,
        plotly=Markup(get_plotlyjs()),
        figures=json_in_html(figures),
        **values,
    )


def json_in_html(content: object) -> Markup:
    """Return JSON that stands in an element of a page as it is, whatever its strings hold.

    "</script" would end the element, and after "<!--" and "<script" in a string its end tag would not. As escapes of
    JSON, neither stands in the page; U+2028 and U+2029 end a line of JavaScript and are escapes as all that is not
    ASCII.

    Parameters
    ----------
    content : object
        Anything that `json.dumps` takes.

    Returns
    -------
    Markup
        The text, safe inside a script element.
    """
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return Markup(text.translate({ord(character): f"\\u{ord(character):04x}" for character in "<>&"}))


def _asset(name: str) -> Markup:
    return Markup((files("duralab.report") / name).read_text(encoding="utf-8"))
