"""What the local methods regress on: the samples of a segment, and how many lines around each one."""

import numpy as np
import pytest
from known_plants import noise_layout, periodic_experiment, respond

from duralab_settings import EstimatorKind
from identifier import EstimatorOptions, estimate
from identifier.estimators.local_polynomial import local_polynomial_model
from identifier.estimators.local_rational import local_rational_model
from identifier.estimators.local_regression import LocalSums
from identifier.estimators.local_solution import _mean_square, solve_local
from identifier.estimators.segments import Segments

CHOSEN = {"order": 2, "half_width": None, "segment_blocks": 16}


@pytest.mark.parametrize("piece", [100, 1024, 10**6])
def test_segments_are_the_samples_of_the_captures_and_nothing_else(piece):
    drive, layout = periodic_experiment(periods=2, experiments=3, drives=1)
    segments = Segments(layout, channels=1, segment_blocks=16)
    found = [
        segment.copy()
        for start in range(0, drive.shape[1], piece)
        for segment in segments.next_segments(drive[:, start : start + piece])
    ]
    np.testing.assert_array_equal(found, [drive[:, c.start : c.start + 2048] for c in layout.captures])


@pytest.mark.parametrize(("samples", "blocks", "expected"), [(10_000, 4, 2), (10_000, 16, 1), (10_001, 3, 3)])
def test_a_stretch_of_noise_is_divided_into_equal_segments_about_as_long_as_asked(samples, blocks, expected):
    segments = Segments(noise_layout(samples), channels=1, segment_blocks=blocks)
    record = np.arange(float(samples))[None, :]
    found = [segment.copy() for segment in segments.next_segments(record)]
    assert len(found) == expected
    length = samples // expected
    np.testing.assert_array_equal(np.concatenate(found, axis=1), record[:, : expected * length])


def lines_needed(drives, segments, *, denominator):
    """Lines of a neighbourhood whose equations, less those of the transient, are twice the unknowns."""
    unknowns = 3 * drives + (2 if denominator else 0)
    return -(-2 * unknowns // segments) + 3


@pytest.mark.parametrize("drives", [1, 6, 30])
@pytest.mark.parametrize("segments", [1, 2, 40])
@pytest.mark.parametrize(
    ("choose", "usual", "denominator"),
    [(local_rational_model, 30, True), (local_polynomial_model, 16, False)],
)
def test_a_neighbourhood_is_as_wide_as_usual_or_just_wide_enough(choose, usual, denominator, drives, segments):
    width = choose(drives=drives, segments=segments, **CHOSEN).half_width
    needed = lines_needed(drives, segments, denominator=denominator)
    assert width >= usual
    assert 2 * width + 1 >= needed
    assert width == usual or 2 * (width - 1) < needed


def test_every_capture_counts_for_the_width_of_a_neighbourhood():
    alone, layout = periodic_experiment(block=256, delay=1, periods=1, experiments=2, drives=1)
    once = alone[:, : layout.samples // 2]
    drive = np.vstack([np.hstack([once, once]), np.hstack([once, -once])])
    found = estimate(EstimatorKind.LOCAL_POLYNOMIAL, drive, respond(drive), layout, EstimatorOptions(order=12))
    # 26 unknowns: two captures of 41 lines less 13 for the transient of each leave 30, the usual 33 lines would 14.
    assert np.all(found.degrees_of_freedom[found.valid] == 2 * (41 - 13) - 26)


@pytest.mark.parametrize("choose", [local_rational_model, local_polynomial_model])
def test_a_response_that_is_silent_around_a_line_is_named(choose):
    drive = np.random.default_rng(1).standard_normal((2, 30_000))
    model = choose(drives=2, segments=2, **CHOSEN)
    sums = LocalSums(noise_layout(30_000), drives=2, responses=2, model=model)
    sums.add(drive, drive * [[1.0], [0.0]])
    with pytest.raises(ValueError, match=r"Response 1 is silent around excited line 0; check its sensor"):
        solve_local(sums)


@pytest.mark.parametrize("choose", [local_rational_model, local_polynomial_model])
def test_drives_that_are_copies_around_a_line_are_named(choose):
    drive = np.random.default_rng(1).standard_normal((1, 30_000)) * [[1.0], [2.0]]
    sums = LocalSums(noise_layout(30_000), drives=2, responses=1, model=choose(drives=2, segments=2, **CHOSEN))
    sums.add(drive, drive[:1])
    with pytest.raises(ValueError, match=r"drive 1 cannot be told from the others"):
        solve_local(sums)


def test_the_mean_square_of_a_complex_polynomial_is_that_of_its_values():
    polynomial = np.array([[1.0, 0.3 - 0.8j, 0.5j], [1.0, 0.0, -2.0 + 1.0j]])
    place, weight = np.polynomial.legendre.leggauss(8)
    values = np.abs(polynomial @ place ** np.arange(3)[:, None]) ** 2
    np.testing.assert_allclose(_mean_square(polynomial), values @ weight / 2.0, rtol=1e-12)


@pytest.mark.parametrize("layout", [noise_layout(9_000), periodic_experiment(periods=2, experiments=3)[1]])
@pytest.mark.parametrize("choose", [local_rational_model, local_polynomial_model])
def test_the_equations_to_come_are_those_that_come(layout, choose):
    record = np.random.default_rng(1).standard_normal((2, layout.samples))
    sums = LocalSums(
        layout, drives=2, responses=2, model=choose(drives=2, segments=3, **CHOSEN | {"segment_blocks": 3})
    )
    expected = sums.equations_to_come
    sums.add(record, record)
    assert sums.equations == expected > 0


@pytest.mark.parametrize("kind", list(EstimatorKind))
def test_what_tells_how_good_an_estimate_is_is_real(kind):
    drive = np.random.default_rng(1).standard_normal((2, 20_000))
    drive[1] = 0.6 * np.roll(drive[0], 3) + 0.8 * drive[1]
    found = estimate(kind, drive, respond(drive)[:2] + 0.1 * drive[::-1], noise_layout(20_000))
    for name in ("coherence", "condition_number", "residual_psd", "degrees_of_freedom", "averages"):
        assert getattr(found, name).dtype == np.float64, name


def test_an_order_of_zero_takes_the_frf_for_constant_around_a_line():
    model = local_polynomial_model(drives=1, segments=1, **CHOSEN | {"order": 0})
    assert (model.order, model.denominator_order) == (0, 0)
    with pytest.raises(ValueError, match="Orders -1 and 0"):
        local_polynomial_model(drives=1, segments=1, **CHOSEN | {"order": -1})


def test_a_segment_has_a_block_or_more():
    assert EstimatorOptions(segment_blocks=1).segment_blocks == 1
    assert local_polynomial_model(drives=1, segments=1, **CHOSEN | {"segment_blocks": 1}).segment_blocks == 1
    with pytest.raises(ValueError, match="0 blocks in a segment"):
        EstimatorOptions(segment_blocks=0)
