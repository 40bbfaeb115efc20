"""The local rational method (LRM): a common denominator per response lets it follow sharp resonances."""

from identifier.estimators.local_regression import LocalModel

DEFAULT_ORDER = 2
DEFAULT_HALF_WIDTH = 30


def local_rational_model(
    *, drives: int, segments: int, order: int | None, half_width: int | None, segment_blocks: int
) -> LocalModel:
    """Choose the neighbourhood of the local rational method.

    It is linear least squares of ``A Y - B U - T``: exact for a single resonance, and, as every such fit, a little
    biased by noise on the responses where the FRF bends within the neighbourhood.

    Source: McKelvey, Guérin, "Non-parametric frequency response estimation using a local rational model", SYSID 2012.
    """
    chosen = DEFAULT_ORDER if order is None else order
    needed = -(-2 * ((chosen + 1) * drives + chosen) // segments) + chosen + 1
    width = max(DEFAULT_HALF_WIDTH, -(-needed // 2)) if half_width is None else half_width
    return LocalModel(order=chosen, denominator_order=chosen, half_width=width, segment_blocks=segment_blocks)
