"""Reports of one campaign or a comparison of several: an offline HTML file, or a PDF."""

from duralab.report.campaign_report import write_report
from duralab.report.comparison_report import write_comparison
from duralab.report.pdf import find_browser, write_pdf
from duralab.report.project_report import EventSection, write_project_report
from duralab.report.rendering import render, write_page

__all__ = [
    "EventSection",
    "find_browser",
    "render",
    "write_comparison",
    "write_page",
    "write_pdf",
    "write_project_report",
    "write_report",
]
