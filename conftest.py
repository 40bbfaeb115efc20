"""Tiers of the tests: what lies in one of these folders is long, and `make test` leaves it to `make test-all`."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parent
LONG_FOLDERS = {"long", "security", "faults", "deploy", "multihost", "endurance"}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the long tests by their folder."""
    for item in items:
        if LONG_FOLDERS.intersection(item.path.relative_to(ROOT).parent.parts):
            item.add_marker(pytest.mark.long)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print what tests recorded as `printed`, also those of another process."""
    lines = [
        text
        for report in terminalreporter.getreports("passed")
        if report.when == "call"
        for name, text in report.user_properties
        if name == "printed"
    ]
    if lines:
        terminalreporter.section("times of the tutorials")
        for text in lines:
            terminalreporter.write_line(text)
