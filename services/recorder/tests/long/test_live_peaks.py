"""A peak of one sample is seen in a viewer whose every pixel covers many samples."""

import time

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from headless_viewer import START_SECONDS, picture_of, pixels, viewer_of

from recorder.live.playbacks import iteration
from recorder.live.series import LATEST_COLOUR, RUN_TIME, Curve, Group, Look
from recorder.live.stream import close_stream, open_stream, send_blueprint

SAMPLES = 60_000


@pytest.fixture
def spiked_file(tmp_path):
    """A curve at 0 for 60 s with one sample of 1, in a plot from -1 to 1."""
    values = np.zeros(SAMPLES)
    values[SAMPLES // 2] = 1.0
    path = tmp_path / "spike.rrd"
    stream = open_stream("spike", file=path, viewer=None).stream
    curve = Curve(Group.DRIVE, "left", iteration(1))
    plot = rrb.TimeSeriesView(origin="drive/left", axis_y=rrb.ScalarAxis(range=(-1.0, 1.0), zoom_lock=True))
    hidden = (rrb.BlueprintPanel(state="hidden"), rrb.SelectionPanel(state="hidden"), rrb.TimePanel(state="hidden"))
    send_blueprint(stream, rrb.Blueprint(plot, *hidden, auto_layout=False, auto_views=False))
    stream.log(curve.path, curve.style(Look.LATEST), static=True)
    times = rr.TimeColumn(RUN_TIME, duration=np.arange(SAMPLES) / 1000.0)
    stream.send_columns(curve.path, [times], rr.Scalars.columns(scalars=values))
    assert close_stream(stream)
    return path


def test_one_sample_of_many_under_a_pixel_is_drawn_as_high_as_it_is(
    spiked_file, rerun_program, viewer_environment, tmp_path
):
    deadline, drawn = time.monotonic() + START_SECONDS, np.zeros(0, dtype=int)
    with viewer_of(spiked_file, rerun_program, viewer_environment, tmp_path) as viewer:
        while drawn.size == 0 and time.monotonic() < deadline:
            picture = picture_of(viewer)
            # Not the legend.
            rows = pixels(picture[:, picture.shape[1] // 4 : 3 * picture.shape[1] // 4], LATEST_COLOUR).any(axis=1)
            drawn = np.flatnonzero(rows)
    # The line at 0 is halfway down; the peak reaches the top of the plot, which begins below the viewer's bars.
    assert drawn.size
    assert drawn.max() > 0.4 * picture.shape[0]
    assert drawn.min() < 0.12 * picture.shape[0], drawn.min() / picture.shape[0]
