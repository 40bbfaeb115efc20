"""Tiers of the tests: what lies in one of these folders is long, and `make test` leaves it to `make test-all`."""

import subprocess
from collections.abc import Callable, Iterator
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


@pytest.fixture
def mount_disk(tmp_path: Path) -> Iterator[Callable[[str, int], Path]]:
    """Mount file systems of a name and a size in bytes; a test is skipped where that is not allowed."""
    mounted: list[Path] = []

    def mount(name: str, size: int) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
        try:
            done = subprocess.run(command, capture_output=True, check=False)
        except FileNotFoundError:
            pytest.skip("there is no mount command here")
        if done.returncode != 0:
            pytest.skip(f"mounting a small file system is not allowed here: {done.stderr.decode().strip()}")
        mounted.append(folder)
        return folder

    yield mount
    for folder in mounted:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)
