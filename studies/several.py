"""Run several studies in one process, where what they share is played once: `several.py figure_7 figure_8 figure_9`."""

from __future__ import annotations

import argparse
import runpy
import sys
from pathlib import Path

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Run studies of this folder one after the other.")
    parser.add_argument("names", nargs="+", help="scripts of this folder, without suffix")
    for name in parser.parse_args().names:
        script = Path(__file__).with_name(f"{name}.py")
        sys.argv = [str(script)]
        runpy.run_path(str(script), run_name="__main__")
