"""Measure how soon the page is there: `python services/operator_page/tests/first_paint.py [--loads 30]`.

Each load is one of a browser with an empty cache: the time to the first paint, and to the first rig on the screen Lab.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[2] / "duralab" / "tests")]

from browser import Browser, browser_program  # noqa: E402
from page_in_browser import Page  # noqa: E402
from page_lab import PageLab  # noqa: E402

FIRST_RIG = (
    "new Promise((done) => { const look = () => document.querySelector('article.card')"
    "? done(performance.now()) : requestAnimationFrame(look); look(); })"
)
PAINTED = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"


def main() -> None:
    """Print median and range of both times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loads", type=int, default=30)
    loads = parser.parse_args().loads
    with tempfile.TemporaryDirectory() as temporary, PageLab(Path(temporary)) as lab:
        served = lab.page("page")
        with Browser(browser_program(), Path(temporary) / "profile") as browser:
            page = Page(browser, served.address)
            browser.call("Network.setCacheDisabled", cacheDisabled=True)
            times = []
            for _ in range(loads):
                browser.call("Page.navigate", url=served.address)
                rig = page.value(FIRST_RIG)
                page.wait(PAINTED)
                times.append((page.value(PAINTED), rig))
            requests = page.value("performance.getEntriesByType('resource').length")
    for name, values in zip(("first paint", "first rig"), np.array(times).T, strict=True):
        low, middle, high = np.percentile(values, [0, 50, 100])
        sys.stdout.write(f"{name}: {middle:.0f} ms ({low:.0f} to {high:.0f})\n")
    sys.stdout.write(f"{loads} loads, {requests} requests each, load of the machine {os.getloadavg()[0]:.1f}\n")


if __name__ == "__main__":
    main()
