import numpy as np
import pytest

from duralab_roads import Road, add_potholes

COLUMNS = np.arange(-1.2, 1.21, 0.1)


def _flat(length=200.0, spacing=0.02):
    return Road(spacing, COLUMNS, np.zeros((round(length / spacing) + 1, COLUMNS.size)))


@pytest.fixture(scope="module")
def holed():
    return add_potholes(_flat(), count=12, seed=4, lead_in_m=40.0)


def test_the_lead_in_stays_whole(holed):
    assert np.all(holed.elevation[: round(40 / 0.02)] == 0)
    assert holed.elevation[round(40 / 0.02) :].min() < -0.02


def test_every_hole_lies_in_one_wheel_track_and_within_its_bounds(holed):
    sunk = holed.elevation < 0
    rows = sunk.any(axis=1)
    starts = np.flatnonzero(np.diff(rows.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(rows.astype(int), append=0) == -1)
    assert starts.size == 12
    sides = []
    for start, end in zip(starts, ends, strict=True):
        hole = holed.elevation[start : end + 1]
        touched = COLUMNS[(hole < 0).any(axis=0)]
        assert np.all(np.abs(np.abs(touched) - 0.75) < 0.3)
        assert np.all(np.sign(touched) == np.sign(touched[0]))
        assert 0.02 * 0.9 < -hole.min() <= 0.05
        assert (end - start) * 0.02 <= 1.0
        sides.append(np.sign(touched[0]))
    assert set(sides) == {-1.0, 1.0}


def test_edges_are_rounded_as_steeply_as_a_half_cosine_allows(holed):
    steepest = np.abs(np.diff(holed.elevation, axis=0)).max() / 0.02
    assert 0.5 * np.pi * 0.02 / 2 / 0.15 < steepest <= np.pi * 0.05 / 2 / 0.15 + 1e-9


def test_holes_are_sunk_into_the_road_that_is_there():
    rough = Road(0.02, COLUMNS, np.random.default_rng(1).standard_normal((10_001, COLUMNS.size)))
    sunk = add_potholes(rough, count=12, seed=4, lead_in_m=40.0).elevation - rough.elevation
    np.testing.assert_allclose(sunk, add_potholes(_flat(), count=12, seed=4, lead_in_m=40.0).elevation, atol=1e-14)


def test_one_seed_gives_the_same_bytes_and_no_holes_the_same_road(holed):
    assert add_potholes(_flat(), count=12, seed=4, lead_in_m=40.0).elevation.tobytes() == holed.elevation.tobytes()
    assert not np.array_equal(add_potholes(_flat(), count=12, seed=5, lead_in_m=40.0).elevation, holed.elevation)
    assert np.all(add_potholes(_flat(), count=0, seed=4, lead_in_m=40.0).elevation == 0)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"count": -1}, "count"),
        ({"count": 400}, "do not fit"),
        ({"lead_in_m": 300.0}, "do not fit"),
        ({"lead_in_m": float("nan")}, "lead_in_m"),
        ({"depth_m": (0.05, 0.02)}, "depth_m"),
        ({"length_m": (0.0, 1.0)}, "length_m"),
        ({"edge_m": 0.3}, "edge_m"),
        ({"track_width_m": 3.0}, "track_width_m"),
    ],
)
def test_impossible_holes_are_refused_by_name(changes, named):
    with pytest.raises(ValueError, match=named):
        add_potholes(_flat(), **{"count": 5, "seed": 0, "lead_in_m": 10.0, **changes})
