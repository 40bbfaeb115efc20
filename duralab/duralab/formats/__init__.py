"""Signals in file formats of durability engineering; each format is imported at its first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from duralab.lazy_face import lazy_face

if TYPE_CHECKING:
    from duralab.formats.columns import LEFT_OUT
    from duralab.formats.controller_files import ExportedDrive, ImportedResponse, export_drive, import_response
    from duralab.formats.errors import FormatError, Written
    from duralab.formats.exchange import Format, FormatPlugin, format_of, read_signals, write_signals
    from duralab.formats.uff58 import FrequencyResponse, read_frequency_response, write_frequency_response
    from duralab.formats.units import SI_UNITS, add_calculated, convert_units, named_units

__all__ = [
    "LEFT_OUT",
    "SI_UNITS",
    "ExportedDrive",
    "Format",
    "FormatError",
    "FormatPlugin",
    "FrequencyResponse",
    "ImportedResponse",
    "Written",
    "add_calculated",
    "convert_units",
    "export_drive",
    "format_of",
    "import_response",
    "named_units",
    "read_frequency_response",
    "read_signals",
    "write_frequency_response",
    "write_signals",
]

__getattr__ = lazy_face(__name__)
