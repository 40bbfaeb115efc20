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
        # "</" would end the script element, wherever it stands in a string.
        figures=Markup(json.dumps(figures, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")),
        **values,
    )


def _asset(name: str) -> Markup:
    return Markup((files("duralab.report") / name).read_text(encoding="utf-8"))
