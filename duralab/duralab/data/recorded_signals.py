"""Signals of a recording with a note whether they are in the control band."""

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
    """Signals of a recording whose labelled arrays cannot be mixed with those of another band.

    `note`: Description of the signals.
    """

    note: BandNote = field(kw_only=True)

    def to_xarray(self, name: str = "signals") -> xarray.DataArray:
        """Return a labelled array like `Signals.to_xarray`, with the coordinate `band` and attributes."""
        from duralab.data.band_index import marked

        return marked(super().to_xarray(name), self.note)


@dataclass(frozen=True, eq=False, repr=False)
class RecordedTarget(RecordedSignals):
    """Target of a recording: signals in the control band; a call returns a dataset in the layout of the responses.

    `dataset`: Function that makes the dataset.
    """

    dataset: Callable[[bool], xarray.Dataset] = field(kw_only=True)

    def __call__(self, *, in_band: bool) -> xarray.Dataset:
        """Return the target in the layout of `Recording.responses`: a variable for each channel over `time`.

        `in_band`: True for the target in the form used for judging, False for the target as given, with its static part
        and the part outside the control band.
        Returns: Dataset; subtracting `responses(in_band=...)` of another band is refused.
        Raises `InputError`: `in_band` is neither True nor False.
        """
        return self.dataset(in_band)
