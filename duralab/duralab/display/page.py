"""Results as a separate page, without a notebook."""

from __future__ import annotations

from html import escape
from typing import Final

_STYLE: Final = (
    ":root{color-scheme:light dark}body{font:14px sans-serif;margin:2em auto;max-width:60em;padding:0 1em}"
    "table{border-collapse:collapse;margin:1em 0}td,th{padding:.15em .8em .15em 0}caption{margin-bottom:.3em}"
)


def to_html(*results: object, title: str = "Duralab") -> str:
    """Return results as one offline HTML page, with their notebook views.

    Parameters
    ----------
    *results : object
        Results of the SDK, or other objects; an object without an HTML view is shown as text.
    title : str
        Title of the page.

    Returns
    -------
    str
        HTML page; write it as UTF-8.
    """
    parts = []
    for result in results:
        look = getattr(result, "_repr_html_", None)
        parts.append(look() if look is not None else f"<pre>{escape(str(result))}</pre>")
    body = "<hr>".join(parts)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body>{body}</body></html>\n"
    )
