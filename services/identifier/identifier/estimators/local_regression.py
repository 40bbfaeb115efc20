"""Least squares over the lines around each line, segment by segment: the sums of both local methods.

Around a line, with ``r`` the distance from it, ``A(r) Y = B(r) U + T(r)``: `B` is the FRF times `A`, and `T` the
leakage of the segment's ends, smooth in frequency as the FRF. `T` differs between segments and is projected out; the
rest is kept as the triangular factor of all equations so far, whose size does not grow with the record.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identifier.estimators.segments import Segments
from identifier.layout import Layout

DEFAULT_ORDER = 2

_LINES_TOGETHER = 32


@dataclass(frozen=True)
class LocalModel:
    """Lines and polynomials of a local method.

    `order`: Order of numerator and transient, 0 or more. `denominator_order`: 0 for the local polynomial method (LPM);
    `order` for the local rational one (LRM): a common denominator for each response follows sharp resonances.
    `half_width`: Lines of a segment to either side; for a capture of P periods, P times as many. `segment_blocks`:
    Number of blocks in a segment of noise: more resolve a resonance more finely.
    """

    order: int
    denominator_order: int
    half_width: int
    segment_blocks: int

    def __post_init__(self) -> None:
        if self.order < 0 or self.denominator_order < 0 or self.half_width < 1 or self.segment_blocks < 1:
            raise ValueError(
                f"Orders {self.order} and {self.denominator_order}, half-width {self.half_width}, "
                f"{self.segment_blocks} blocks in a segment; orders must be 0 or more, the others 1 or more."
            )


class LocalSums:
    """Running least squares at the excited lines of a layout.

    Columns of the triangular factor: drives times ``r^0``, ``r^1``, …, then responses times ``r^0``, ``r^1``, ….

    `layout`: Layout of the experiment. `drives`, `responses`: Numbers of channels, 1 or more. `model`: Orders and
    widths. `reach`: Half of the neighbourhood's width, in hertz.
    Raises `ValueError`: The neighbourhood is wider than the spectrum.
    """

    def __init__(self, layout: Layout, *, drives: int, responses: int, model: LocalModel) -> None:
        self.model = model
        self.drives, self.responses = drives, responses
        self.lines = np.flatnonzero(layout.excited)
        self.equations = 0
        self._layout = layout
        self._segments = Segments(layout, channels=drives + responses, segment_blocks=model.segment_blocks)
        shortest = min(self._segments.length_of(capture) for capture in layout.captures)
        widths = {self._width(self._segments.length_of(capture)) for capture in layout.captures}
        if max(widths) > shortest // 2 - 1:
            raise ValueError(
                f"A neighbourhood of {max(widths)} lines is wider than the spectrum of {shortest} samples; "
                "take a smaller half-width or a longer record."
            )
        self.reach = model.half_width * self._stride(shortest) * layout.sample_rate / shortest
        columns = drives * (model.order + 1) + responses * (model.denominator_order + 1)
        self.factor = np.zeros((self.lines.size, columns, columns), dtype=np.complex128)

    @property
    def unknowns(self) -> int:
        """Number of unknowns of a response at a line."""
        return self.drives * (self.model.order + 1) + self.model.denominator_order

    def fewest_half_width(self, surplus: float) -> int:
        """Return the smallest half width that determines the unknowns."""
        captures = self._layout.captures
        segments = sum(self._layout.samples_of(each) // self._segments.length_of(each) for each in captures)
        return max(1, math.ceil((surplus * self.unknowns / segments + self.model.order) / 2.0))

    @property
    def equations_to_come(self) -> int:
        """Number of `equations` after the whole record."""
        total = 0
        for capture in self._layout.captures:
            length = self._segments.length_of(capture)
            of_segment = max(0, self._width(length) - self.model.order - 1)
            total += self._layout.samples_of(capture) // length * of_segment
        return total

    def add(self, drive: NDArray[np.float64], response: NDArray[np.float64]) -> None:
        """Add the next samples of the whole record, fades and delay blocks included."""
        for segment in self._segments.next_segments(np.concatenate((drive, response))):
            self._take(segment)

    def _stride(self, length: int) -> int:
        """Return the lines of a segment from one excited line to the next, for a periodic drive."""
        return length // self._layout.block_samples if self._layout.periodic else 1

    def _width(self, length: int) -> int:
        return 2 * self.model.half_width * self._stride(length) + 1

    def _take(self, segment: NDArray[np.float64]) -> None:
        length, width = segment.shape[1], self._width(segment.shape[1])
        rate = self._layout.sample_rate
        # In units of a density, so that segments of different lengths are weighted by their information.
        spectra = np.fft.rfft(segment, axis=1).T * np.sqrt(2.0 / (rate * length))
        frequency = self._layout.frequency[self.lines]
        # The line of the mean and the Nyquist line are not part of the neighbourhood of any other.
        first = np.clip(np.rint(frequency * length / rate).astype(int) - width // 2, 1, (length - 1) // 2 - width + 1)
        transient = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, width), self.model.order + 1))[0]
        for start in range(0, self.lines.size, _LINES_TOGETHER):
            some = slice(start, start + _LINES_TOGETHER)
            around = first[some, None] + np.arange(width)
            distance = (around * (rate / length) - frequency[some, None]) / self.reach
            equations = self._columns(spectra[around], distance)
            equations -= transient @ (transient.T @ equations)
            self.factor[some] = _triangular(np.concatenate((self.factor[some], equations), axis=1))
        self.equations += width - transient.shape[1]

    def _columns(self, values: NDArray[np.complex128], distance: NDArray[np.float64]) -> NDArray[np.complex128]:
        power = distance[:, :, None]
        drive, response = values[:, :, : self.drives], values[:, :, self.drives :]
        return np.concatenate(
            [drive * power**exponent for exponent in range(self.model.order + 1)]
            + [response * power**exponent for exponent in range(self.model.denominator_order + 1)],
            axis=2,
        )


def _triangular(rows: NDArray[np.complex128]) -> NDArray[np.complex128]:
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.complex128)
