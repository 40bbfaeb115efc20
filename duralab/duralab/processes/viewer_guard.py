"""Guard of a program: ends it with standard input. `python -m duralab.processes.viewer_guard PROGRAM [ARGUMENT …]`.

The Rerun viewer does not detect the end of its parent process. This process does, because its standard input ends, and
then ends the viewer; so no viewer remains, even if the lab is killed.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from contextlib import suppress
from types import FrameType
from typing import Final

END_SECONDS: Final = 2.0


def guard(arguments: list[str]) -> int:
    """Run a program until it ends, standard input ends, or SIGTERM arrives; return its exit code."""
    child = subprocess.Popen(arguments, stdin=subprocess.DEVNULL)

    def end(*_: object) -> None:
        child.terminate()
        with suppress(subprocess.TimeoutExpired):
            child.wait(END_SECONDS)
        if child.poll() is None:
            child.kill()

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        threading.Thread(target=end, daemon=True).start()

    def follow_parent() -> None:
        while sys.stdin.buffer.read(4096):
            pass
        end()

    signal.signal(signal.SIGTERM, on_signal)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=follow_parent, daemon=True).start()
    return child.wait()


if __name__ == "__main__":
    sys.exit(guard(sys.argv[1:]))
