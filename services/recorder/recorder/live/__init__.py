"""Live view in Rerun, from the streams of a campaign or from its log.

Rerun is imported with the first name that draws, so that a recorder joins the bus without waiting for the import.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from recorder.live.pandas_left_out import leave_out_pandas
from recorder.live.views import LiveViews

if TYPE_CHECKING:
    from recorder.live.rebuild import Shown, UnreadableFileError, recording_of, show_log
    from recorder.live.view import LiveView

__all__ = [
    "LiveView",
    "LiveViews",
    "Shown",
    "UnreadableFileError",
    "leave_out_pandas",
    "recording_of",
    "show_log",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{'view' if name == 'LiveView' else 'rebuild'}"), name)
