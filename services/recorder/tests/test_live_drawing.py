from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from duralab_proto.v1 import iterator_pb2, rig_pb2
from recorder.live.charts import CANVAS, Axes, frequency_ticks
from recorder.live.frf import draw_frf
from recorder.live.series import colour_of
from recorder.live.tables import COLUMNS_SHOWN, damage_table, error_table, status_document
from recorder.live.thinning import bucket_samples, keep_extremes

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
    return draw_frf(
        frequency,
        frf,
        coherence,
        responses=["a [N]", "b [N]"],
        drives=["u [m]", "v [m]"],
        drive_ranges=[0.2, 0.2],
        band=(1, 40),
    )


def test_lines_without_an_estimate_are_left_out():
    frf = np.ones((101, 2, 2), dtype=complex) * 1e5
    coherence = np.full((101, 2), 0.9)
    whole = len(draw(frf, coherence).strips)
    frf[40] = np.nan
    broken = draw(frf, coherence)
    # Each of the four magnitude curves and the two phases falls into two pieces.
    assert len(broken.strips) == whole + 6
    assert all(np.isfinite(strip).all() for strip in broken.strips)


def test_the_phase_of_a_delay_is_broken_where_it_wraps_and_falls_everywhere_else():
    # exp(-2 pi j f tau) with tau of 50 ms falls by 360 degrees in 20 Hz: to 40 Hz it wraps twice, at 10 and 30 Hz.
    frequency = np.linspace(0, 50, 401)
    frf = np.zeros((401, 2, 2), dtype=complex)
    frf[:, 0, 0] = frf[:, 1, 1] = np.exp(-2j * np.pi * frequency * 0.05)
    drawing = draw(frf, np.full((401, 2), 1.0))
    curves = [
        strip
        for strip, colour, width in zip(drawing.strips, drawing.strip_colours, drawing.strip_widths, strict=True)
        if colour == colour_of(0) and width == 1.4
    ]
    assert len(curves) == 3
    # Downwards on the canvas is down in phase.
    assert all(np.all(np.diff(strip[:, 1]) > 0) for strip in curves)


def test_the_drive_that_moves_a_response_most_is_broad_whatever_a_resonance_of_another_does():
    frf = np.ones((101, 2, 2), dtype=complex)
    frf[:, 0, 1] = 0.1
    frf[90, 0, 1] = 1e6
    frf[:, 1, 0] = 0.1
    drawing = draw(frf, np.full((101, 2), 1.0))
    broad = [c for c, width in zip(drawing.strip_colours, drawing.strip_widths, strict=True) if width == 2.0]
    assert broad == [colour_of(0), colour_of(1)]


def test_an_frf_of_zeros_is_no_error():
    assert draw(np.zeros((101, 2, 2), dtype=complex), np.zeros((101, 2))).labels


def test_everything_is_drawn_on_the_canvas():
    drawing = draw(np.ones((101, 2, 2), dtype=complex) * 3e4, np.full((101, 2), 0.5))
    points = np.concatenate([*drawing.strips, np.array(drawing.label_places)])
    assert points.min() >= -20
    assert np.all(points.max(axis=0) <= CANVAS)


def test_the_best_iteration_is_bold(campaign):
    made = [campaign.metrics(1, 0.5), campaign.metrics(2, 0.1), campaign.metrics(3, 0.2)]
    # Where the target was reached the iterator names the last one, whatever the error of another.
    told = error_table(made, iterator_pb2.CampaignStatus(iterations=made, best_iteration=3))
    assert told.splitlines()[2] == "| left_vertical | 50.0 | 10.0 | **20.0** |"
    assert error_table(made, iterator_pb2.CampaignStatus(iterations=made[:1], best_iteration=1)) == error_table(made)
    table = error_table(made)
    assert table.splitlines()[2] == "| left_vertical | 50.0 | **10.0** | 20.0 |"


def at_level(metrics, level):
    metrics.level = level
    return metrics


def test_only_a_playback_of_the_whole_target_is_the_best(campaign):
    half, whole = at_level(campaign.metrics(1, 0.1), 0.5), at_level(campaign.metrics(2, 0.4), 1.0)
    assert "**" not in error_table([half])
    assert error_table([half, whole]).splitlines()[2] == "| left_vertical | 10.0 | **40.0** |"


def test_a_watched_channel_without_a_target_has_no_error(campaign):
    metrics = campaign.metrics(1, 0.2)
    metrics.channels[1].watched = True
    metrics.channels[1].relative_rms_error = float("nan")
    assert error_table([metrics]).splitlines()[3] == "| right_vertical | – |"


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


def test_every_outcome_is_told_in_words_of_its_own(campaign):
    told = set()
    for outcome in iterator_pb2.Outcome.values():
        status = campaign.status(iterator_pb2.CAMPAIGN_PHASE_FINISHED)
        status.outcome = outcome
        told.add(status_document(status, []))
    assert len(told) == len(iterator_pb2.Outcome.values())


def test_a_latched_interlock_is_the_heading_with_its_reason(campaign):
    state = campaign.state(rig_pb2.RIG_MODE_INTERLOCKED, reason="left_vertical left its limit")
    document = status_document(campaign.status(iterator_pb2.CAMPAIGN_PHASE_ITERATING), [], state=state)
    assert document.splitlines()[0] == "# Rig front_axle: INTERLOCKED: left_vertical left its limit"


def test_the_run_that_moves_a_rig_is_named_and_one_that_plays_is_no_heading(campaign):
    moving = campaign.state(rig_pb2.RIG_MODE_INTERLOCKED, reason="it was hot", run="demo.i03")
    assert "INTERLOCKED, still moved by run demo.i03: it was hot" in status_document(None, [], state=moving)
    document = status_document(None, [], state=campaign.state(rig_pb2.RIG_MODE_PLAYING, run="demo.i03"))
    assert document.splitlines()[0] == "Rig front_axle: playing, run demo.i03"


def spending(metrics, playback, *identification):
    for channel in metrics.channels:
        channel.specimen_damage.extend(playback)
        channel.identification_damage.extend(identification)
    return metrics


def test_the_damage_spent_is_shown_for_identification_playbacks_and_both_at_the_campaigns_slope(campaign):
    before = (2.0, 123456.0, 9.0)
    made = [
        spending(campaign.metrics(1, 0.5), (1.0, 3.5, 2.0), *before),
        spending(campaign.metrics(2, 0.1), (1.0, 1.0, 4.0), *before),
    ]
    made[1].channels[1].identification_damage[:] = [float("nan")] * 3
    confirmed = [spending(campaign.metrics(2, 0.1), (1.0, 1.25, 4.0))]
    rows = damage_table(made, confirmed, exponent=5.0).splitlines()
    assert rows[2] == "| left_vertical | 123,000 | 5.8 | 123,000 |"
    # No target, no multiple of its damage.
    assert rows[3].startswith("| right_vertical | – |")
    assert damage_table(made, confirmed, exponent=8.0).splitlines()[2] == "| left_vertical | 9.0 | 10.0 | 19.0 |"
    status = iterator_pb2.CampaignStatus(iterations=made, confirmations=confirmed)
    assert "k = 3 | identification | playbacks | sum |" in status_document(status, made, exponent=3.0)


def test_a_recording_that_does_not_state_the_damage_says_so(campaign):
    metrics = campaign.metrics(1, 0.5)
    assert damage_table([metrics], exponent=5.0) == "Damage spent on the specimen: not stated in this recording."
    table = damage_table([spending(metrics, (1.0, 2.0, 3.0))], exponent=5.0)
    assert "| left_vertical | – | 2.0 | 2.0 |" in table
    assert table.endswith("does not state the damage of the identification, so that is not counted.")
