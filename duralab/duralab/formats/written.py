"""What a writer says of the file it wrote."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Written:
    """A file that was written, and what of the signals is not in it as it was.

    Parameters
    ----------
    path : Path
        The file.
    format : str
        Value of `duralab.formats.Format`.
    samples : int
        Samples of each channel.
    padding : int
        Zeros that follow them because the format stores whole groups; 0 where it does not.
    largest_errors : tuple of float
        For each channel the largest difference between a sample and what the file holds of it, in the channel's unit,
        measured while it was written; 0 where samples are stored as they are.
    notes : tuple of str
        Sentences about what the format could not keep.
    """

    path: Path
    format: str
    samples: int
    padding: int
    largest_errors: tuple[float, ...]
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return it in words."""
        padding = f", {self.padding} zeros appended" if self.padding else ""
        return "\n- ".join((f"{self.path}: {self.samples} samples as {self.format}{padding}", *self.notes))
