"""Draw docs/pictures/report.png: a screenshot of a report in a browser.

`python scripts/report_picture.py [out/demo/report.html] [--out docs/pictures/report.png]`
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from duralab.report import find_browser

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "report.png"
WIDTH, HEIGHT = 1400, 1750


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=Path, nargs="?", default=Path("out/demo/report.html"))
    parser.add_argument("--out", type=Path, default=PICTURE)
    parser.add_argument("--width", type=int, default=WIDTH)
    parser.add_argument("--height", type=int, default=HEIGHT)
    asked = parser.parse_args()
    browser = find_browser()
    if browser is None:
        sys.exit("No browser is on the search path; install chromium.")
    if not asked.report.is_file():
        sys.exit(f"There is no report {asked.report}; `make demo` writes out/demo/report.html.")
    with tempfile.TemporaryDirectory() as profile:
        command = [
            browser,
            "--headless=new",
            *(["--no-sandbox"] if os.geteuid() == 0 else []),
            "--disable-gpu",
            "--hide-scrollbars",
            "--virtual-time-budget=60000",
            f"--user-data-dir={profile}",
            f"--window-size={asked.width},{asked.height}",
            f"--screenshot={asked.out.resolve()}",
            asked.report.resolve().as_uri(),
        ]
        subprocess.run(command, check=True, capture_output=True, timeout=300)
    # A page has few colours; a palette reduces the size to a third.
    Image.open(asked.out).convert("RGB").quantize(128).save(asked.out, optimize=True)


if __name__ == "__main__":
    main()
