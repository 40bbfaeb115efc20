"""Potholes: rounded holes at seeded positions, each in one wheel track."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from duralab_roads.road import Road


def add_potholes(
    road: Road,
    *,
    count: int,
    seed: int,
    lead_in_m: float,
    track_width_m: float = 1.5,
    length_m: tuple[float, float] = (0.4, 1.0),
    width_m: tuple[float, float] = (0.4, 0.6),
    depth_m: tuple[float, float] = (0.02, 0.05),
    edge_m: float = 0.15,
) -> Road:
    """Add potholes to a road, each in the left or the right wheel track.

    The road after the lead-in is divided into `count` equal segments with one hole each, so holes never overlap.

    Parameters
    ----------
    road
        Road to damage; it is not changed.
    count
        Number of holes, at least 0.
    seed
        Seed of place, side and size, at least 0.
    lead_in_m
        Distance from the start [m] that is not damaged, at least 0.
    track_width_m
        Distance of the wheel tracks [m]; holes are centred at half of it on either side.
    length_m, width_m, depth_m
        Least and greatest size [m], uniformly drawn; length and width include the edges.
    edge_m
        Length of the rounded (half cosine) edge at each end and side [m], at most half of the least length or width.

    Returns
    -------
    Road
        Same grid with holes.

    Raises
    ------
    ValueError
        If a size is not allowed, the road is narrower than the tracks, or the holes do not fit into it.
    """
    for name, (least, greatest) in {"length_m": length_m, "width_m": width_m, "depth_m": depth_m}.items():
        if not (math.isfinite(greatest) and 0 < least <= greatest):
            raise ValueError(f"{name} is ({least}, {greatest}); give finite values with 0 < least <= greatest, in m.")
    if count < 0 or not (math.isfinite(lead_in_m) and lead_in_m >= 0):
        raise ValueError(f"count is {count} and lead_in_m {lead_in_m}; both must be at least 0.")
    if not 0 < edge_m <= min(length_m[0], width_m[0]) / 2:
        raise ValueError(
            f"edge_m is {edge_m} m; it must be above 0 and at most {min(length_m[0], width_m[0]) / 2} m, "
            "half of the smallest hole."
        )
    half_track = track_width_m / 2
    if not road.lateral_positions[0] <= -half_track < half_track <= road.lateral_positions[-1]:
        raise ValueError(
            f"track_width_m is {track_width_m}; the road reaches from {road.lateral_positions[0]} to "
            f"{road.lateral_positions[-1]} m."
        )
    if count == 0:
        return road
    stretch = (road.length - lead_in_m) / count
    if stretch < length_m[1]:
        raise ValueError(
            f"{count} potholes of up to {length_m[1]} m do not fit into {road.length - lead_in_m:.1f} m of road; "
            "lower count or lengthen the road."
        )
    generator = np.random.default_rng(seed)
    along = road.spacing * np.arange(road.elevation.shape[0])
    elevation = road.elevation.copy()
    for index in range(count):
        length, width, depth = (generator.uniform(*bounds) for bounds in (length_m, width_m, depth_m))
        side = half_track if generator.random() < 0.5 else -half_track
        start = lead_in_m + stretch * index + generator.uniform(0, stretch - length)
        rows = slice(*np.searchsorted(along, [start, start + length]))
        shape_along = _plateau(along[rows] - start - length / 2, size=length, edge=edge_m)
        shape_across = _plateau(road.lateral_positions - side, size=width, edge=edge_m)
        elevation[rows] -= depth * shape_along[:, None] * shape_across[None, :]
    return Road(road.spacing, road.lateral_positions, elevation)


def _plateau(offset: NDArray[np.float64], *, size: float, edge: float) -> NDArray[np.float64]:
    """Return 1 in the middle, a half cosine over `edge` at both ends, 0 beyond `size` (all in m)."""
    inward = np.clip((size / 2 - np.abs(offset)) / edge, 0, 1)
    return (1 - np.cos(np.pi * inward)) / 2
