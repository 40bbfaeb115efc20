"""Tables, as text and as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

Row = Sequence[str]


def text_table(headings: Row, rows: Sequence[Row], *, left: int = 0) -> str:
    """Return a table as text, its columns as wide as they must be.

    `headings`: Of the columns. `rows`: As many cells in each as there are headings. `left`: This many columns, from the
    first, are set flush left, the others flush right.
    Returns: The lines of the table, without a line end after the last.
    """
    widths = [max(len(line[i]) for line in (headings, *rows)) for i in range(len(headings))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column < left else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in (headings, *rows)
    )


def html_table(headings: Row, rows: Sequence[Row], *, left: int = 0, caption: str = "") -> str:
    """Return the same as HTML, every cell escaped; see `text_table`.

    `headings`: Headings of the columns. `rows`: As many cells in each as there are headings. `left`: This many columns,
    from the first, are set flush left, the others flush right. `caption`: Text above the table.
    Returns: A table element.
    """

    def line(tag: str, cells: Row) -> str:
        aligned = ("left" if column < left else "right" for column in range(len(cells)))
        inside = "".join(
            f'<{tag} style="text-align:{side}">{escape(cell)}</{tag}>'
            for cell, side in zip(cells, aligned, strict=True)
        )
        return f"<tr>{inside}</tr>"

    title = f'<caption style="text-align:left">{escape(caption)}</caption>' if caption else ""
    body = "".join(line("td", row) for row in rows)
    return f"<table>{title}<thead>{line('th', headings)}</thead><tbody>{body}</tbody></table>"
