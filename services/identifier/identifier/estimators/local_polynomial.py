"""The local polynomial method (LPM): FRF and leakage as polynomials over neighbouring lines."""

from identifier.estimators.local_regression import LocalModel

DEFAULT_ORDER = 2
DEFAULT_HALF_WIDTH = 16
"""Lines of a segment of 16 blocks to either side: one line of the block's grid, about what a Hann window covers."""


def local_polynomial_model(
    *, drives: int, segments: int, order: int | None, half_width: int | None, segment_blocks: int
) -> LocalModel:
    """Choose the neighbourhood of the local polynomial method.

    Source: Pintelon & Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed., chapter 7.
    """
    chosen = DEFAULT_ORDER if order is None else order
    needed = -(-2 * (chosen + 1) * drives // segments) + chosen + 1
    width = max(DEFAULT_HALF_WIDTH, -(-needed // 2)) if half_width is None else half_width
    return LocalModel(order=chosen, denominator_order=0, half_width=width, segment_blocks=segment_blocks)
