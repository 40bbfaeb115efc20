"""Parquet tables by pyarrow: "time [s]", then "<name> [<unit>]" for each channel."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from duralab.data import Signals
from duralab.formats.columns import headings, named_in_headings, signals_read
from duralab.formats.errors import FormatError, Written, require_file
from duralab.formats.libraries import parsing, require_library, require_room

_EXPECTED: Final = "a Parquet table"
_OWN: Final = b"duralab."
"""Prefix of the attributes in the metadata, which other writers use too."""


def read_parquet(path: Path) -> Signals:
    """Read a Parquet table of columns "time [s]", then "<name> [<unit>]" for each channel."""
    pyarrow = require_library("pyarrow", extra="parquet")
    parquet = require_library("pyarrow.parquet", extra="parquet")
    require_file(path)
    with parsing(path, _EXPECTED) as stream:
        file = parquet.ParquetFile(stream)
        names, units = named_in_headings(path, file.schema_arrow.names)
        for field in file.schema_arrow:
            if not (pyarrow.types.is_integer(field.type) or pyarrow.types.is_floating(field.type)):
                raise FormatError(
                    path,
                    f"the column {field.name!r} is of type {field.type}; integers or floating point, the time in "
                    "seconds, were expected.",
                )
        rows = file.metadata.num_rows
        require_room(path, rows * (len(names) + 1))
        values = np.empty((len(names) + 1, rows))
        filled = 0
        for batch in file.iter_batches():
            for row, column in enumerate(batch.columns):
                if column.null_count:
                    raise FormatError(path, f"the column {batch.schema.names[row]!r} has nulls; numbers were expected.")
                values[row, filled : filled + len(column)] = column.to_numpy(zero_copy_only=False)
            filled += batch.num_rows
        if filled != rows:
            raise FormatError(path, f"{rows} rows were announced, and {filled} are there; copy or save it again.")
        metadata = file.schema_arrow.metadata or {}
        attributes = {
            key.removeprefix(_OWN).decode(): text.decode() for key, text in metadata.items() if key.startswith(_OWN)
        }
    return signals_read(path, names, units, values[1:], time=values[0], attributes=attributes)


def write_parquet(signals: Signals, path: Path) -> Written:
    """Write a Parquet table of float64; attributes go into its metadata."""
    pyarrow = require_library("pyarrow", extra="parquet")
    parquet = require_library("pyarrow.parquet", extra="parquet")
    metadata = {_OWN + key.encode(): text.encode() for key, text in signals.attributes.items()}
    table = pyarrow.Table.from_arrays(
        [pyarrow.array(signals.time), *(pyarrow.array(row) for row in signals.samples)],
        schema=pyarrow.schema([(name, pyarrow.float64()) for name in headings(signals)], metadata=metadata),
    )
    parquet.write_table(table, path, compression="zstd")
    return Written(path, "parquet", signals.samples.shape[1], 0, (0.0,) * len(signals.channels))
