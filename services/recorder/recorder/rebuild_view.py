"""The live view of a recording, made again: `python -m recorder.rebuild_view RECORDING.mcap … --out FILE.rrd`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from recorder.live_rebuild import recording_of, show_log
from recorder.live_view import LiveView
from recorder.mcap_damage import DAMAGE


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the view of a recording; 0 where it is written."""
    parser = argparse.ArgumentParser(description="Make the live view of a recording again from its log.")
    parser.add_argument("files", type=Path, nargs="+", help="the recording's files, the first one first")
    parser.add_argument("--out", type=Path, required=True, help="the .rrd file to write")
    given = parser.parse_args(arguments)
    try:
        view = LiveView(recording_of(given.files), file=given.out, viewer=None)
        try:
            shown = show_log(view, given.files)
        finally:
            view.close()
    except (OSError, *DAMAGE) as error:
        sys.stderr.write(f"The recording {given.files[0]} cannot be shown: {error}.\n")
        return 1
    if not shown:
        sys.stderr.write(f"The recording {given.files[0]} cannot be shown: it holds no message that has a picture.\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
