"""Signals in the files that durability engineers exchange; each format is imported when it is used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from duralab.formats.errors import FormatError
    from duralab.formats.exchange import Format, read_signals, write_signals
    from duralab.formats.frequency_responses import FrequencyResponse
    from duralab.formats.uff58 import read_frequency_response, write_frequency_response
    from duralab.formats.units import convert_units
    from duralab.formats.written import Written

_MODULE_OF = {
    "Format": "exchange",
    "FormatError": "errors",
    "FrequencyResponse": "frequency_responses",
    "Written": "written",
    "convert_units": "units",
    "read_frequency_response": "uff58",
    "read_signals": "exchange",
    "write_frequency_response": "uff58",
    "write_signals": "exchange",
}

__all__ = [
    "Format",
    "FormatError",
    "FrequencyResponse",
    "Written",
    "convert_units",
    "read_frequency_response",
    "read_signals",
    "write_frequency_response",
    "write_signals",
]


def __getattr__(name: str) -> object:
    """Import what is asked for."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
