"""Index of labelled arrays that prevents mixing of signals of two bands."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any, TypeVar

import xarray

from duralab.data.band import BandNote
from duralab.errors import InputError

LabelledT = TypeVar("LabelledT", xarray.DataArray, xarray.Dataset)


class BandIndex(xarray.Index):
    """Index of the coordinate `band`: in-band and as-measured signals cannot be aligned, and so not subtracted.

    `band`: Value of the coordinate.
    """

    def __init__(self, band: str) -> None:
        self.band = band

    @classmethod
    def from_variables(
        cls, variables: Mapping[Any, xarray.Variable], *, options: Mapping[str, Any] | None = None
    ) -> BandIndex:
        """Make the index of the coordinate."""
        del options
        (variable,) = variables.values()
        return cls(str(variable.values))

    def create_variables(
        self, variables: Mapping[Any, xarray.Variable] | None = None
    ) -> dict[Hashable, xarray.Variable]:
        """Return the coordinate unchanged."""
        return dict(variables or {})

    def equals(self, other: xarray.Index, *, exclude: frozenset[Hashable] | None = None) -> bool:
        """Return whether both are in band, or both as measured."""
        del exclude
        return isinstance(other, BandIndex) and self.band == other.band

    def join(self, other: xarray.Index, how: str = "inner") -> BandIndex:
        """Refuse to join two unequal indexes, as xarray requests."""
        del how
        others = other.band if isinstance(other, BandIndex) else type(other).__name__
        raise InputError(
            f"Some signals are {self.band}, others {others}; ask for all with the same `in_band=`, or drop the "
            "coordinate `band` of all if you mean to mix them.",
            field="in_band",
        )


def marked(labelled: LabelledT, note: BandNote) -> LabelledT:
    """Mark labelled signals as in band or as measured, by coordinate and attributes, and enforce it by an index.

    `labelled`: Signals. `note`: Their description.
    Returns: The signals with the coordinate `band` and the attributes of the note.
    """
    labelled = labelled.assign_coords(band=note.band).set_xindex("band", BandIndex)
    labelled.attrs |= note.attributes
    if isinstance(labelled, xarray.Dataset):
        for variable in labelled.data_vars.values():
            variable.attrs |= note.attributes
    return labelled
