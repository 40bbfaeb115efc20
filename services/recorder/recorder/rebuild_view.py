"""Rebuild the live view of a recording: `python -m recorder.rebuild_view RECORDING.mcap … --out FILE.rrd`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from recorder.live import LiveView, Shown, UnreadableFileError, leave_out_pandas, recording_of, show_log


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the view of a recording; return 0 if it is written, also if a file has no end, which is reported."""
    parser = argparse.ArgumentParser(description="Make the live view of a recording again from its log.")
    parser.add_argument("files", type=Path, nargs="+", help="the recording's files, the first one first")
    parser.add_argument("--out", type=Path, required=True, help="the .rrd file to write")
    given = parser.parse_args(arguments)
    try:
        shown = _write(given.files, given.out)
    except UnreadableFileError as error:
        return _refuse(given.files, str(error))
    except OSError as error:
        return _refuse(given.files, f"{error.filename} cannot be read ({error.strerror}); give its .mcap files")
    except RuntimeError as error:
        # An error of Rerun; errors of a damaged file are reported above.
        return _refuse(given.files, f"its view {given.out} cannot be written ({error}); give another --out")
    if not shown.messages:
        return _refuse(given.files, "it holds no message that has a picture")
    for path in shown.cut:
        sys.stderr.write(
            f"The file {path} has no end and is shown as far as it is whole; where its recorder was killed, it repairs "
            "the file when it is started again.\n"
        )
    return 0


def _write(files: Sequence[Path], out: Path) -> Shown:
    """Write the view; the output is removed if no message was drawn."""
    view = LiveView(recording_of(files), file=out, viewer=None)
    shown = Shown()
    try:
        shown = show_log(view, files)
    finally:
        view.close()
        if not shown.messages and out.is_file():
            out.unlink()
    return shown


def _refuse(files: Sequence[Path], why: str) -> int:
    sys.stderr.write(f"The recording {files[0]} cannot be shown: {why}.\n")
    return 1


if __name__ == "__main__":
    leave_out_pandas()
    sys.exit(main())
