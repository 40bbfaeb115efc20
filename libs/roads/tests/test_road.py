import numpy as np
import pytest

from duralab_roads import Road, level, repeat_mirrored


def _road(rows=50, seed=3):
    return Road(0.1, np.array([-1.0, 0.0, 2.0]), np.random.default_rng(seed).standard_normal((rows, 3)))


@pytest.mark.parametrize(
    ("spacing", "positions", "elevation", "named"),
    [
        (0.0, [0.0], np.zeros((3, 1)), "spacing"),
        (np.nan, [0.0], np.zeros((3, 1)), "spacing"),
        (0.1, [1.0, 0.0], np.zeros((3, 2)), "ascend"),
        (0.1, [0.0, 0.0], np.zeros((3, 2)), "ascend"),
        (0.1, [0.0, np.nan], np.zeros((3, 2)), "finite position"),
        (0.1, [0.0], np.zeros((3, 2)), r"shape \(3, 2\)"),
        (0.1, [0.0], np.zeros((1, 1)), r"shape \(1, 1\)"),
        (0.1, [0.0], np.full((3, 1), np.inf), "infinite"),
    ],
)
def test_a_malformed_grid_is_refused_by_name(spacing, positions, elevation, named):
    with pytest.raises(ValueError, match=named):
        Road(spacing, np.array(positions), elevation)


def test_a_road_cannot_be_changed_behind_its_back():
    heights = np.zeros((3, 1))
    road = Road(0.1, np.array([0.0]), heights)
    heights[1] = 5.0
    assert road.elevation.max() == 0.0
    with pytest.raises(ValueError, match="read-only"):
        road.elevation[0, 0] = 1.0


def test_mirroring_makes_no_step_and_keeps_every_height():
    road = _road()
    longer = repeat_mirrored(road, 17.3)
    steps = np.abs(np.diff(road.elevation, axis=0)).max()
    assert longer.length == pytest.approx(17.3)
    assert np.abs(np.diff(longer.elevation, axis=0)).max() <= steps
    np.testing.assert_array_equal(longer.elevation[:50], road.elevation)
    np.testing.assert_array_equal(longer.elevation[49:99], road.elevation[::-1])
    np.testing.assert_array_equal(longer.elevation[98:148], road.elevation)


@pytest.mark.parametrize("length", [0.0, -1.0, np.inf, np.nan])
def test_an_impossible_length_is_refused(length):
    with pytest.raises(ValueError, match="length_m"):
        repeat_mirrored(_road(), length)


def test_levelling_removes_exactly_a_plane_and_keeps_holes_in_the_measurement():
    road = _road(rows=400)
    flat = level(road)
    along = 0.1 * np.arange(400)[:, None]
    tilted = road.elevation + 2.1 + 0.05 * along - 0.02 * road.lateral_positions
    tilted[7, 1] = np.nan
    without = level(Road(0.1, road.lateral_positions, tilted))
    again = level(Road(0.1, road.lateral_positions, np.where(np.isnan(tilted), np.nan, road.elevation)))
    np.testing.assert_allclose(without.elevation, again.elevation, atol=1e-12)
    assert np.isnan(without.elevation[7, 1])
    np.testing.assert_allclose(level(flat).elevation, flat.elevation, atol=1e-12)
    assert abs(flat.elevation.mean()) < 1e-12


def test_a_road_without_any_measured_point_cannot_be_levelled():
    with pytest.raises(ValueError, match="no measured point"):
        level(Road(0.1, np.array([0.0]), np.full((3, 1), np.nan)))
