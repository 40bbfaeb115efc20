"""Tiers of the tests: what lies in one of these folders is long, and `make test` leaves it to `make test-all`."""

import subprocess
from collections.abc import Callable, Container, Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent
LONG_FOLDERS = {"long", "security", "faults", "deploy", "multihost", "endurance"}


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave files of the tier that is not asked for unread: their imports take longer than many tests."""
    if collection_path.is_dir():
        return True if config.getoption("markexpr") == "not long" and collection_path.name in LONG_FOLDERS else None
    is_test = collection_path.name.startswith("test_") and collection_path.suffix == ".py"
    return True if config.getoption("markexpr") == "long" and is_test and not _is_long(collection_path) else None


def _is_long(path: Path) -> bool:
    return bool(LONG_FOLDERS.intersection(path.relative_to(ROOT).parent.parts))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the long tests by their folder."""
    for item in items:
        if _is_long(item.path):
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


class LossyLink:
    """Stands in for the Zenoh publisher under a StreamPublisher and loses some of its messages, as a full link does."""

    def __init__(self, publisher: Any, *, lost: Container[int]) -> None:
        self._publisher, self._lost, self._seq = publisher, lost, 0

    def put(self, payload: Any, **options: Any) -> None:
        """Publish a message, or lose it."""
        if self._seq not in self._lost:
            self._publisher.put(payload, **options)
        self._seq += 1

    def undeclare(self) -> None:
        """End the publisher."""
        self._publisher.undeclare()


@pytest.fixture(scope="session")
def lose() -> Callable[[Any, Container[int]], None]:
    """Let the next messages of a publisher be lost that have these numbers, counted from here."""

    def put_link(publisher: Any, numbers: Container[int]) -> None:
        # No link can be told to lose certain messages.
        publisher._publisher.current = LossyLink(publisher._publisher.current, lost=numbers)  # noqa: SLF001

    return put_link


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
