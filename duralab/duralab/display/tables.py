"""Tables, as text and as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

Row = Sequence[str]


def text_table(headings: Row, rows: Sequence[Row], *, left: int = 0) -> str:
    """Return a table as text, with minimal column widths.

    `headings`: Headings of the columns. `rows`: Rows with a cell for each heading. `left`: Number of left-aligned
    columns, from the first; the others are right-aligned.
    Returns: Lines of the table, without a line end after the last.
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
    """Return a table as HTML, with escaped cells; see `text_table`.

    `headings`: Headings of the columns. `rows`: Rows with a cell for each heading. `left`: Number of left-aligned
    columns, from the first; the others are right-aligned. `caption`: Text above the table.
    Returns: Table element.
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
