from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from duralab_drive_map import DriveMap, MapTerm

from .arc_rig import NAMES, SAMPLE_RATE, UNITS, drive

SQUARE = MapTerm(1, (0, 0), (0.4, 0.1, -0.03))


def drive_map(*terms, names=NAMES, units=UNITS, scale=(0.01, 0.002), highest=42.0):
    return DriveMap(names, units, scale, terms, SAMPLE_RATE, highest)


def three_drives(*terms):
    return drive_map(*terms, names=("a", "b", "c"), units=("m", "N", "N"), scale=(0.01, 50.0, 20.0))


def test_drive_and_mapped_drive_are_each_others_inverse_at_every_amplitude():
    map_ = three_drives(
        MapTerm(1, (0, 0), (0.4, 0.1, -0.03)),
        MapTerm(2, (0, 1), (0.3, -0.2, 0.05)),
        MapTerm(2, (0, 0), (-0.1, 0.0, 0.01)),
    )
    for amplitude in (1e-3, 1.0, 30.0):
        u = amplitude * np.vstack((drive(level=(0.01, 50.0)), drive(seed=3, level=(0.01, 20.0))[1:]))
        v = map_.to_mapped(u)
        assert not np.allclose(u[1], v[1], atol=1e-3 * np.abs(u[1]).max()) or amplitude < 1.0
        np.testing.assert_allclose(map_.to_drive(v), u, rtol=0.0, atol=1e-12 * np.abs(v).max())
        np.testing.assert_allclose(map_.to_mapped(map_.to_drive(u)), u, rtol=0.0, atol=1e-11 * np.abs(v).max())


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 900), st.integers(2, 5))
def test_any_acyclic_map_of_any_length_is_inverted_exactly(seed, samples, drives):
    rng = np.random.default_rng(seed)
    place = rng.permutation(drives)
    terms = [
        MapTerm(int(place[k]), tuple(sorted((int(place[i]), int(place[j])))), tuple(rng.uniform(-0.2, 0.2, 3)))
        for k in range(drives)
        for i in range(k)
        for j in range(i, k)
        if rng.random() < 0.6
    ]
    names = tuple(f"drive_{i}" for i in range(drives))
    map_ = drive_map(*terms, names=names, units=("m",) * drives, scale=(1.0,) * drives, highest=20.0)
    u = rng.standard_normal((drives, samples))
    v = map_.to_mapped(u)
    np.testing.assert_allclose(map_.to_drive(v), u, rtol=0.0, atol=1e-12 * max(1.0, np.abs(v).max()))


def test_products_are_of_what_is_moved_where_an_actuator_does_not_follow_its_drive():
    half = replace(drive_map(SQUARE), moved=lambda i, samples: 0.5 * samples if i == 0 else samples)
    u = drive()
    v = half.to_mapped(u)
    np.testing.assert_array_equal(v[0], u[0])
    np.testing.assert_allclose(v[1] - u[1], 0.25 * (drive_map(SQUARE).to_mapped(u)[1] - u[1]), atol=1e-15)
    np.testing.assert_allclose(half.to_drive(v), u, rtol=0.0, atol=1e-12 * np.abs(v).max())
    assert half == drive_map(SQUARE)


def test_rest_stays_rest():
    map_ = drive_map(SQUARE)
    rest = np.zeros((2, 500))
    np.testing.assert_array_equal(map_.to_mapped(rest), 0.0)
    np.testing.assert_array_equal(map_.to_drive(rest), 0.0)


def test_without_a_term_every_byte_stays():
    u = drive(seconds=5.0)
    before = u.tobytes()
    identity = drive_map()
    assert identity.is_identity
    assert identity.describe() == ()
    assert identity.to_mapped(u).tobytes() == before
    assert identity.to_drive(u).tobytes() == before


def test_a_static_coefficient_adds_the_product_itself_from_0_hz_on():
    """Oracle: the product at the drives' own rate, which holds 40 Hz here."""
    scale = (0.01, 0.002)
    u = drive(seconds=20.0, highest=20.0)
    expected = 0.002 * 0.4 * (u[0] / 0.01) ** 2
    found = drive_map(MapTerm(1, (0, 0), (0.4, 0.0, 0.0)), scale=scale).to_mapped(u) - u
    np.testing.assert_allclose(found[1], expected, atol=1e-5 * expected.max())
    assert found[1].mean() == pytest.approx(expected.mean(), rel=1e-6)
    np.testing.assert_array_equal(found[0], 0.0)


def test_the_rate_coefficient_differentiates():
    samples, frequency = 4000, 3.0
    time = np.arange(samples) / SAMPLE_RATE
    u = np.zeros((2, samples))
    u[0] = np.sin(2.0 * np.pi * frequency * time)
    term = MapTerm(1, (0, 0), (0.0, 1.0, 0.0))
    found = drive_map(term, scale=(1.0, 1.0)).to_mapped(u)[1]
    slope = 2.0 * np.pi * 2.0 * frequency * 0.5 * np.sin(4.0 * np.pi * frequency * time) / (2.0 * np.pi * 10.0)
    middle = slice(1000, 3000)
    np.testing.assert_allclose(found[middle], slope[middle], atol=1e-5)


def test_products_do_not_fold_back_and_nothing_is_added_above_the_fade():
    """80 Hz beyond half the sample rate of 100 Hz would fold to 40 Hz."""
    samples = 8000
    time = np.arange(samples) / SAMPLE_RATE
    window = np.hanning(samples)
    u = np.zeros((2, samples))
    u[0] = np.cos(2.0 * np.pi * 80.0 * time) * window
    found = drive_map(MapTerm(1, (0, 0), (1.0, 0.0, 0.0)), scale=(1.0, 1.0), highest=85.0).to_mapped(u)[1]
    power = np.abs(np.fft.rfft(found * window)) ** 2
    frequency = np.fft.rfftfreq(samples, 1.0 / SAMPLE_RATE)
    assert power[np.abs(frequency - 40.0) < 1.0].max() < 1e-12 * power.max()
    loud = drive_map(SQUARE, highest=30.0).to_mapped(drive(seconds=40.0)) - drive(seconds=40.0)
    power = np.abs(np.fft.rfft(loud[1])) ** 2
    frequency = np.fft.rfftfreq(loud.shape[1], 1.0 / SAMPLE_RATE)
    assert power[frequency > 33.2].sum() < 1e-8 * power.sum()


def test_the_end_of_a_record_does_not_wrap_to_its_start():
    u = np.zeros((2, 3000))
    u[:, -200:] = drive(seconds=1.0)
    found = drive_map(SQUARE).to_mapped(u)
    assert np.abs(found[1, :1500]).max() < 1e-6 * np.abs(found[1] - u[1]).max()


def test_a_unit_changes_units_only():
    u = drive(seconds=10.0)
    millimetres = np.array([1000.0, 1.0])
    in_millimetres = drive_map(SQUARE, units=("mm", "m"), scale=(10.0, 0.002))
    found = in_millimetres.to_mapped(u * millimetres[:, None]) / millimetres[:, None]
    np.testing.assert_allclose(found, drive_map(SQUARE).to_mapped(u), rtol=0.0, atol=1e-12 * np.abs(found[1]).max())


@pytest.mark.parametrize(
    "terms",
    [
        (MapTerm(0, (0, 0), (1.0, 0.0, 0.0)),),
        (MapTerm(0, (0, 1), (1.0, 0.0, 0.0)),),
        (MapTerm(1, (0, 0), (1.0, 0.0, 0.0)), MapTerm(0, (1, 1), (1.0, 0.0, 0.0))),
        (
            MapTerm(1, (0, 0), (1.0, 0.0, 0.0)),
            MapTerm(2, (0, 1), (1.0, 0.0, 0.0)),
            MapTerm(0, (2, 2), (1.0, 0.0, 0.0)),
        ),
    ],
)
def test_terms_that_close_a_cycle_are_refused(terms):
    with pytest.raises(ValueError, match=r"close a cycle .* follows .* no drive may follow itself"):
        three_drives(*terms)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scale": (0.01, 0.0)}, "scale of lateral .* above 0"),
        ({"scale": (0.01,)}, "2 names, 2 units and 1 scales"),
        ({"highest": 91.0}, "at most at 0.45 of the sample rate, 90 Hz"),
        ({"highest": 0.0}, "above 0"),
    ],
)
def test_values_out_of_range_are_refused(change, said):
    with pytest.raises(ValueError, match=said):
        drive_map(SQUARE, **change)


def test_terms_out_of_range_are_refused():
    with pytest.raises(ValueError, match="there are 2, counted from 0"):
        drive_map(MapTerm(2, (0, 0), (1.0, 0.0, 0.0)))
    with pytest.raises(ValueError, match="twice; state it once"):
        drive_map(SQUARE, SQUARE)
    with pytest.raises(ValueError, match="those of a product rise"):
        MapTerm(2, (1, 0), (1.0, 0.0, 0.0))
    for coefficients in ((1.0,), (np.nan, 0.0, 0.0)):
        with pytest.raises(ValueError, match="give 3 finite numbers"):
            MapTerm(1, (0, 0), coefficients)
    with pytest.raises(ValueError, match="3 channels; the drive map has 2 drives"):
        drive_map(SQUARE).to_mapped(np.zeros((3, 10)))
    with pytest.raises(ValueError, match="finite"):
        drive_map(SQUARE).to_drive(np.full((2, 10), np.nan))


def test_a_map_of_another_rig_or_unit_is_refused():
    map_ = drive_map(SQUARE)
    map_.require_drives(NAMES, UNITS, sample_rate=SAMPLE_RATE)
    with pytest.raises(ValueError, match="for the drives vertical, lateral and the rig has a, b"):
        map_.require_drives(("a", "b"), UNITS, sample_rate=SAMPLE_RATE)
    with pytest.raises(ValueError, match="vertical in m and the rig has it in mm"):
        map_.require_drives(NAMES, ("mm", "m"), sample_rate=SAMPLE_RATE)
    with pytest.raises(ValueError, match="200 Hz and the rig plays 256 Hz"):
        map_.require_drives(NAMES, UNITS, sample_rate=256.0)


def test_terms_are_said_in_the_drives_own_units():
    # 1.71 = 0.4275 · 0.0004 / 0.01²
    arc = MapTerm(1, (0, 0), (0.4275, 0.0, 0.0))
    assert drive_map(arc, scale=(0.01, 0.0004)).describe() == ("lateral follows −1.71 /m × vertical²",)
    assert three_drives(MapTerm(2, (0, 1), (-0.5, 0.0, 0.0))).describe() == ("c follows 20 /m × a × b",)
    assert three_drives(MapTerm(0, (1, 2), (-1.0, 0.0, 0.0))).describe() == ("a follows 1e-05 m/N² × b × c",)
    mixed = drive_map(
        MapTerm(0, (1, 2), (1.0, 0.0, 0.0)), names=("a", "b", "c"), units=("m", "N", "bar"), scale=(1.0, 1.0, 1.0)
    )
    assert mixed.describe() == ("a follows −1 m/(N·bar) × b × c",)
