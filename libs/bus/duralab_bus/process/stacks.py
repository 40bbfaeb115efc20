"""What a process is doing: for a service that seems to stand still, and that nothing must make worse."""

from __future__ import annotations

import signal
import sys
import threading
import traceback

import structlog


def stacks() -> dict[str, list[str]]:
    """Return where every thread is, the outermost call first.

    Not by faulthandler, which reads the frames of threads while they run: of three dozen processes that were told to
    end meanwhile, one crashed.
    """
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    return {
        # Without the lines' text: no file is read while a rig plays.
        f"{names.get(number, 'native')} {number}": [
            f"{call.f_code.co_filename}:{line} {call.f_code.co_name}"
            for call, line in reversed(list(traceback.walk_stack(frame)))
        ]
        for number, frame in sys._current_frames().items()  # noqa: SLF001 - the only way, and documented
    }


def log_stacks() -> None:
    """Log where every thread is."""
    structlog.get_logger("duralab_bus").warning("asked where the threads are", threads=stacks())


def log_stacks_on_signal() -> None:
    """Have SIGUSR1 log where every thread is, in a process that is no service of its own; those do it anyway.

    Raises
    ------
    ValueError
        Called on another thread than the main one.
    """
    # On a thread of its own: the main one may be in the middle of a line of the log.
    signal.signal(signal.SIGUSR1, lambda _number, _frame: threading.Thread(target=log_stacks, daemon=True).start())
