"""The report of a campaign: one HTML file that opens offline."""

from duralab.report.page import write_report

__all__ = ["write_report"]
