"""The frequency responses of a model into a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from duralab.data import Model
from duralab.errors import InputError
from duralab.formats import Format, FrequencyResponse, format_of, write_frequency_response
from duralab.output_files import replace_when_complete, require_outputs


def require_frf_file(path: Path) -> None:
    """Refuse a file that cannot hold a frequency response; raises InputError."""
    if format_of(path, None) is not Format.UFF58:
        raise InputError(f"{path} cannot hold a frequency response; give a file that ends in .uff or .unv.")


def write_frf(model: Model, path: Path, *, replace: bool) -> None:
    """Write the frequency responses of a model; lines at both ends that were not excited are left out."""
    # Lines without excitation hold NaN; those at both ends are cut off, one in between is an error.
    known = np.flatnonzero(np.isfinite(model.frf).all(axis=(1, 2)))
    if known.size == 0:
        raise InputError(f"{path} is not written: the model holds no line that was identified.")
    lines = slice(int(known[0]), int(known[-1]) + 1)
    response = FrequencyResponse(model.drives, model.responses, model.frequency[lines], model.frf[lines])
    require_outputs([path], replace=replace)
    with replace_when_complete(path) as temporary:
        write_frequency_response(response, temporary)
