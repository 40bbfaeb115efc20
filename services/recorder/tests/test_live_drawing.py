from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from duralab_proto.v1 import iterator_pb2
from recorder.live_charts import CANVAS, Axes, draw_frf, frequency_ticks
from recorder.live_tables import COLUMNS_SHOWN, error_table, status_document
from recorder.live_thinning import bucket_samples, keep_extremes

signals = hnp.arrays(np.float64, st.integers(1, 300), elements=st.floats(-1e6, 1e6))


@given(samples=signals, bucket=st.integers(2, 50))
def test_thinning_keeps_peaks_and_ends_in_order(samples, bucket):
    kept = keep_extremes(samples, bucket)
    assert np.all(np.diff(kept) > 0)
    assert kept[0] == 0
    assert kept[-1] == samples.size - 1
    assert samples[kept].max() == samples.max()
    assert samples[kept].min() == samples.min()


def test_thinning_leaves_two_points_of_each_bucket():
    samples = np.random.default_rng(1).standard_normal(8000)
    assert len(keep_extremes(samples, 8)) <= 2 * 1000 + 2


def test_a_band_up_to_half_the_sample_rate_loses_nothing():
    assert keep_extremes(np.arange(100.0), bucket_samples(1000.0, 500.0)).size == 100


def test_an_unknown_band_loses_nothing():
    assert bucket_samples(1000.0, 0.0) == 2


def test_ticks_are_one_two_five():
    assert frequency_ticks(0.5, 50.0) == pytest.approx([0.5, 1, 2, 5, 10, 20, 50])


def test_the_corners_of_a_panel_are_its_ranges():
    axes = Axes(100.0, 50.0, 300.0, 200.0, (1.0, 100.0), (-2.0, 2.0), decades=True)
    placed = axes.place(np.array([1.0, 10.0, 100.0]), np.array([0.01, 1.0, 100.0]))
    np.testing.assert_allclose(placed, [(100, 250), (250, 150), (400, 50)])


def draw(frf, coherence):
    frequency = np.linspace(0, 50, frf.shape[0])
    return draw_frf(frequency, frf, coherence, responses=["a [N]", "b [N]"], drives=["u [m]", "v [m]"], band=(1, 40))


def test_lines_without_an_estimate_are_left_out():
    frf = np.ones((101, 2, 2), dtype=complex) * 1e5
    coherence = np.full((101, 2), 0.9)
    whole = len(draw(frf, coherence).strips)
    frf[40] = np.nan
    broken = draw(frf, coherence)
    # Each of the four magnitude curves falls into two pieces.
    assert len(broken.strips) == whole + 4
    assert all(np.isfinite(strip).all() for strip in broken.strips)


def test_an_frf_of_zeros_is_no_error():
    assert draw(np.zeros((101, 2, 2), dtype=complex), np.zeros((101, 2))).labels


def test_everything_is_drawn_on_the_canvas():
    drawing = draw(np.ones((101, 2, 2), dtype=complex) * 3e4, np.full((101, 2), 0.5))
    points = np.concatenate([*drawing.strips, np.array(drawing.label_places)])
    assert points.min() >= -20
    assert np.all(points.max(axis=0) <= CANVAS)


def test_the_best_iteration_is_bold(campaign):
    table = error_table([campaign.metrics(1, 0.5), campaign.metrics(2, 0.1), campaign.metrics(3, 0.2)])
    assert table.splitlines()[2] == "| left_vertical | 50.0 | **10.0** | 20.0 |"


def test_a_long_table_shows_the_first_and_the_last_iterations(campaign):
    table = error_table([campaign.metrics(number, 0.5) for number in range(1, 20)])
    header = table.splitlines()[0]
    assert header.count("it.") == COLUMNS_SHOWN
    assert "it. 1 " in header
    assert "it. 19" in header


def test_a_fault_is_told(campaign):
    status = campaign.status(iterator_pb2.CAMPAIGN_PHASE_FAULTED)
    status.fault.message = "The rig is interlocked."
    assert "The rig is interlocked." in status_document(status, [])
