"""Display of results: tables as text, tables and charts as HTML for a notebook; works offline."""

from duralab.display.charts import MOST_CHARTS, Axis, Curve, line_chart
from duralab.display.page import to_html
from duralab.display.tables import html_table, text_table

__all__ = [
    "MOST_CHARTS",
    "Axis",
    "Curve",
    "html_table",
    "line_chart",
    "text_table",
    "to_html",
]
