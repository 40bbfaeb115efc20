"""What the local methods regress on: the samples of a segment, and how many lines around each one."""

import numpy as np
import pytest
from known_plants import noise_layout, periodic_experiment, respond

from duralab_settings import EstimatorKind
from identifier import EstimatorOptions, estimate
from identifier.estimators.automatic_width import widths_to_try
from identifier.estimators.local_regression import LocalModel, LocalSums
from identifier.estimators.local_solution import _mean_square, solve_local
from identifier.estimators.segments import Segments


def model_of(denominator_order, *, order=2, half_width=16, segment_blocks=16):
    return LocalModel(
        order=order, denominator_order=denominator_order, half_width=half_width, segment_blocks=segment_blocks
    )


DENOMINATORS = pytest.mark.parametrize("denominator_order", [0, 2])


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


def equations(half_width, segments):
    """Equations of a line less those that the transient of order 2 takes."""
    return segments * (2 * half_width + 1 - 3)


@pytest.mark.parametrize("drives", [1, 6, 30])
@pytest.mark.parametrize("segments", [1, 2, 40])
@DENOMINATORS
def test_the_narrowest_width_tried_just_gives_twice_as_many_equations_as_unknowns(segments, drives, denominator_order):
    layout = periodic_experiment(block=1024, delay=1, periods=1, experiments=segments)[1]
    model = model_of(denominator_order)
    widths = widths_to_try(layout, drives=drives, responses=1, model=model)
    found = [sums.model.half_width for sums in widths.candidates]
    unknowns = 3 * drives + denominator_order
    assert equations(found[0], segments) >= 2 * unknowns > equations(found[0] - 1, segments)
    assert found == sorted(set(found))
    # H1 is the reference of captures that do not leak.
    assert widths.narrower is None


@DENOMINATORS
def test_under_a_window_the_reference_is_narrower_than_every_width_tried(denominator_order):
    widths = widths_to_try(noise_layout(60_000), drives=2, responses=2, model=model_of(denominator_order))
    assert 1 <= widths.narrower.model.half_width < widths.candidates[0].model.half_width
    assert widths.narrower.equations_to_come > widths.narrower.unknowns


def test_every_capture_counts_for_the_width_of_a_neighbourhood():
    _, layout = periodic_experiment(block=256, delay=1, periods=1, experiments=2, drives=1)
    widths = widths_to_try(layout, drives=2, responses=2, model=model_of(0, order=12))
    # 26 unknowns: two captures of 39 lines less 13 for the transient of each leave 52 equations, 37 lines would 48.
    assert widths.candidates[0].model.half_width == 19


@DENOMINATORS
def test_a_response_that_is_silent_around_a_line_is_named(denominator_order):
    drive = np.random.default_rng(1).standard_normal((2, 30_000))
    sums = LocalSums(noise_layout(30_000), drives=2, responses=2, model=model_of(denominator_order))
    sums.add(drive, drive * [[1.0], [0.0]])
    with pytest.raises(ValueError, match=r"Response 1 is silent around excited line 0; check its sensor"):
        solve_local(sums)


@DENOMINATORS
def test_drives_that_are_copies_around_a_line_are_named(denominator_order):
    drive = np.random.default_rng(1).standard_normal((1, 30_000)) * [[1.0], [2.0]]
    sums = LocalSums(noise_layout(30_000), drives=2, responses=1, model=model_of(denominator_order))
    sums.add(drive, drive[:1])
    with pytest.raises(ValueError, match=r"drive 1 is not separable from the others"):
        solve_local(sums)


def test_the_mean_square_of_a_complex_polynomial_is_that_of_its_values():
    polynomial = np.array([[1.0, 0.3 - 0.8j, 0.5j], [1.0, 0.0, -2.0 + 1.0j]])
    place, weight = np.polynomial.legendre.leggauss(8)
    values = np.abs(polynomial @ place ** np.arange(3)[:, None]) ** 2
    np.testing.assert_allclose(_mean_square(polynomial), values @ weight / 2.0, rtol=1e-12)


@pytest.mark.parametrize("layout", [noise_layout(9_000), periodic_experiment(periods=2, experiments=3)[1]])
@DENOMINATORS
def test_the_equations_to_come_are_those_that_come(layout, denominator_order):
    record = np.random.default_rng(1).standard_normal((2, layout.samples))
    sums = LocalSums(layout, drives=2, responses=2, model=model_of(denominator_order, segment_blocks=3))
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
    sums = LocalSums(noise_layout(30_000), drives=2, responses=2, model=model_of(0, order=0))
    assert sums.unknowns == 2
    with pytest.raises(ValueError, match="Orders -1 and 0"):
        model_of(0, order=-1)


def test_a_segment_has_a_block_or_more():
    assert EstimatorOptions(segment_blocks=1).segment_blocks == 1
    with pytest.raises(ValueError, match="0 blocks in a segment"):
        EstimatorOptions(segment_blocks=0)
