"""Rendering of a page from its template: style, script, plotly.js and figures in one self-contained file."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import jinja2
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from duralab.output_files import replace_when_complete, require_other
from duralab.report.drawing import Figure

PACKAGE: Final = "duralab.report"
_SHARED: Final = ("frame.html.j2", "parts.html.j2")
"""Templates that the others extend and import."""


@cache
def page_template(name: str, package: str) -> jinja2.Template:
    """Return a compiled template; it is compiled once in a process, which takes a third of a page's time.

    `name`: Name of a file of the package; it may extend a template of this folder. `package`: Package with the
    template.
    """
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(name, ".") for name in dict.fromkeys((package, PACKAGE))]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    for shared in _SHARED:
        environment.get_template(shared)
    return environment.get_template(name)


def render(template: str, *, figures: Mapping[str, Figure], package: str = PACKAGE, **values: Any) -> str:
    """Return a page as HTML.

    `template` and `package`: As for `page_template`. `figures`: Figures by the names of the page's plots: kind, or kind
    and value joined by a hyphen. `**values`: Values for the template.
    Returns: Page with style, script and figures in one file.
    """
    return page_template(template, package).render(
        asset=_asset,
        plotly=Markup(get_plotlyjs()),
        figures=json_in_html(figures),
        **values,
    )


def json_in_html(content: object) -> Markup:
    """Return JSON that can be inserted unchanged into an element of a page, with any strings.

    "</script" in a string would end the element, and after "<!--" and "<script" its end tag would not. Therefore "<",
    ">" and "&" are escaped; U+2028 and U+2029, which end a line of JavaScript, are escaped like all that is not ASCII.
    """
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    # One after the other: `str.translate` takes ten times as long.
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


def write_page(path: str | Path, page: Callable[[], str], *, read: Sequence[Path] = ()) -> Path:
    """Write a page; an existing file is replaced when the new one is complete.

    `path`: Path of the HTML file. `page`: Returns the page; called after the check that `path` is none of `read`.
    `read`: Input files of the page.
    Returns: Path of the HTML file.
    Raises `InputError`: `path` is one of `read` or cannot be written.
    """
    path = Path(path)
    require_other([path], read=read)
    html = page()
    with replace_when_complete(path) as temporary:
        temporary.write_text(html, encoding="utf-8")
    return path


def _asset(name: str) -> Markup:
    return Markup((files(PACKAGE) / name).read_text(encoding="utf-8"))
