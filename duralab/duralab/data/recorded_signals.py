"""Signals of a recording that know whether they are in the control band."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from duralab.data.signals import Signals

if TYPE_CHECKING:
    import xarray
from duralab.data.band import BandNote


@dataclass(frozen=True, eq=False, repr=False)
class RecordedSignals(Signals):
    """Signals of a recording whose labelled arrays refuse to be mixed with those of another band.

    `note`: What they are.
    """

    note: BandNote = field(kw_only=True)

    def to_xarray(self, name: str = "signals") -> xarray.DataArray:
        """Return a labelled array as `Signals.to_xarray` does, with the coordinate `band` and attributes."""
        from duralab.data.band_index import marked

        return marked(super().to_xarray(name), self.note)


@dataclass(frozen=True, eq=False, repr=False)
class RecordedTarget(RecordedSignals):
    """The target of a recording: signals in the control band; called, a dataset in the layout of the responses.

    `dataset`: Makes that dataset.
    """

    dataset: Callable[[bool], xarray.Dataset] = field(kw_only=True)

    def __call__(self, *, in_band: bool) -> xarray.Dataset:
        """Return the target in the layout of `Recording.responses`: a variable for each channel over `time`.

        `in_band`: True for the target as it is judged, False for the target as it was given, with its static part and
        what is outside the control band.
        Returns: The difference with `responses(in_band=...)` of another band is refused.
        Raises `InputError`: `in_band` is neither True nor False.
        """
        return self.dataset(in_band)
