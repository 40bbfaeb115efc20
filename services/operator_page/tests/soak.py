"""Keep the page open while 24 channels at 1 kHz play, and print how the memory of page and service grows.

`python services/operator_page/tests/soak.py --minutes 480`; exit code 1 where either grows by more than `--most` MB an
hour. The event log is filled first: it is bounded, and would look like growth until it is full.
"""

import argparse
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import psutil

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[2] / "duralab" / "tests")]

from browser import Browser, browser_program  # noqa: E402
from page_in_browser import Page  # noqa: E402
from page_lab import RIG, Client, PageLab, PageProcess  # noqa: E402

import duralab  # noqa: E402
from duralab.testing import LinearRig  # noqa: E402
from operator_page.lab_view import MOST_LOG_LINES  # noqa: E402

RESPONSES = 24
RUN_SECONDS = 30.0
EVERY_SECONDS = 15.0
MEBIBYTE = 2.0**20
COLUMNS = ("minutes", "service MB", "page heap MB", "DOM nodes", "listeners", "live")


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def play(lab: duralab.Lab, ended: threading.Event) -> None:
    """Play run after run in real time, until it is ended."""
    drive = 0.01 * np.sin(2.0 * np.pi * 2.0 * np.arange(RUN_SECONDS * 1000.0) / 1000.0)[None, :]
    while not ended.is_set():
        lab.play(RIG, drive, real_time=True)


def fill_log(client: Client) -> None:
    """Fill the event log of the page by taking and releasing the rig."""
    for _ in range(MOST_LOG_LINES // 2 + 1):
        assert client.act(f"/api/rigs/{RIG}/take")[0] == 200
        assert client.post(f"/api/rigs/{RIG}/release")[0] == 200
        time.sleep(0.05)


def measure(page: Page, service: psutil.Process) -> tuple[float, float, float, float]:
    """Return RSS of the service and heap of the page after garbage collection, both in MB; nodes; listeners."""
    page.browser.call("HeapProfiler.collectGarbage")
    found = {one["name"]: one["value"] for one in page.browser.call("Performance.getMetrics")["metrics"]}
    rss = service.memory_info().rss / MEBIBYTE
    return rss, found["JSHeapUsedSize"] / MEBIBYTE, found["Nodes"], found["JSEventListeners"]


def watch(served: PageProcess, browser: Browser, *, minutes: float) -> np.ndarray:
    """Return one row a measurement, in the order of COLUMNS."""
    page = Page(browser, served.address)
    for domain in ("Performance", "HeapProfiler"):
        browser.call(f"{domain}.enable")
    page.go("run")
    page.wait(f"document.querySelectorAll('.plots canvas').length === {RESPONSES}")
    service, began, rows = psutil.Process(served.process.pid), time.monotonic(), []
    while (passed := (time.monotonic() - began) / 60.0) < minutes:
        rows.append((passed, *measure(page, service), page.value("document.querySelectorAll('.live').length")))
        say("  ".join(f"{value:10.2f}" for value in rows[-1]))
        assert page.value("wrong") == []
        time.sleep(EVERY_SECONDS)
    return np.array(rows)


def main() -> int:
    """Run the soak and print slopes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=25.0, help="how long, at least 5")
    parser.add_argument("--most", type=float, default=4.0, help="largest growth of either, MB an hour")
    given = parser.parse_args()
    if given.minutes < 5.0:
        parser.error(f"--minutes is {given.minutes:g}; give 5 or more.")
    ended = threading.Event()
    with tempfile.TemporaryDirectory() as temporary:
        lab = PageLab(Path(temporary))
        lab.rig = LinearRig(RIG, plant=[[([1.0e4 * (row + 1)], [1.0, -0.5])] for row in range(RESPONSES)])
        with lab:
            served = lab.page("soak")
            fill_log(Client(served.address))
            player = threading.Thread(target=play, args=(lab.lab, ended))
            player.start()
            try:
                with Browser(browser_program(), Path(temporary) / "profile") as browser:
                    say("  ".join(f"{name:>10}" for name in COLUMNS))
                    rows = watch(served, browser, minutes=given.minutes)
            finally:
                ended.set()
                player.join()
    settled = rows[rows[:, 0] >= 0.25 * rows[-1, 0]]
    grown = False
    for column in (1, 2):
        slope = np.polyfit(settled[:, 0] / 60.0, settled[:, column], 1)[0]
        grown |= slope > given.most
        say(f"{COLUMNS[column]}: {slope:+.2f} an hour, {8.0 * slope:+.1f} in 8 hours")
    return int(grown)


if __name__ == "__main__":
    sys.exit(main())
