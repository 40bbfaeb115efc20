from __future__ import annotations

import re
import socket
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest
from headless_viewer import START_SECONDS, picture_of, pixels, viewer_of
from mcap.writer import Writer
from printed_view import run_rerun

from duralab_proto.v1 import array_pb2, iterator_pb2, rig_pb2
from recorder import rebuild_view
from recorder.live import LiveView, LiveViews
from recorder.live.limits import DriveLimits
from recorder.live.rig import LINE_COLOURS, ROLE_COLOURS
from recorder.live.series import CHANNEL_COLOURS, LATEST_COLOUR
from recorder.live.stream import close_stream, open_stream


def show_campaign(view: LiveView, campaign) -> None:
    view.show_step(campaign.specification())
    view.show_step(campaign.description())
    view.show_step(campaign.target_in_band())
    for block in campaign.blocks("demo.identify"):
        view.show_block(block)
    view.show_step(campaign.model())
    for iteration, error in ((1, 0.5), (2, 0.2), (3, 0.1)):
        for block in campaign.blocks(f"demo.i{iteration:02d}", gain=1 - error):
            view.show_block(block)
        view.show_pose(campaign.poses(f"demo.i{iteration:02d}"))
        view.show_step(campaign.iteration(iteration, error))
    view.show_state(campaign.state(rig_pb2.RIG_MODE_IDLE))
    view.show_step(campaign.status(iterator_pb2.CAMPAIGN_PHASE_FINISHED))


def write_log(path, campaign):
    """Write the same messages as a recording, with the standard MCAP writer."""
    messages = [campaign.specification(), campaign.description(), campaign.target_in_band()]
    messages += [*campaign.blocks("demo.identify"), campaign.model()]
    for iteration, error in ((1, 0.5), (2, 0.2), (3, 0.1)):
        run = f"demo.i{iteration:02d}"
        messages += [*campaign.blocks(run, gain=1 - error), campaign.poses(run), campaign.iteration(iteration, error)]
    messages += [campaign.state(rig_pb2.RIG_MODE_IDLE), campaign.status(iterator_pb2.CAMPAIGN_PHASE_FINISHED)]
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for message in messages:
            name = message.DESCRIPTOR.full_name
            channel = writer.register_channel(name, "protobuf", writer.register_schema(name, "protobuf", b""))
            writer.add_message(channel, log_time=0, publish_time=0, data=message.SerializeToString())
        writer.finish()


@pytest.fixture
def live_file(tmp_path, campaign):
    path = tmp_path / "demo.rrd"
    view = LiveView("demo", file=path, viewer=None)
    show_campaign(view, campaign)
    view.close()
    return path


def test_the_log_says_once_who_reset_the_rig_and_why(tmp_path, campaign, monkeypatch):
    view = LiveView("demo", file=tmp_path / "demo.rrd", viewer=None)
    lines = []
    monkeypatch.setattr(view, "_note", lambda line, _at: lines.append(line))
    reset = {"reset_name": "Ada", "reset_reason": "oil wiped up"}
    for mode, also in (
        (rig_pb2.RIG_MODE_INTERLOCKED, {"reason": "oil on the floor"}),
        (rig_pb2.RIG_MODE_IDLE, reset),
        (rig_pb2.RIG_MODE_IDLE, reset | {"fraction": 0.5}),
        (rig_pb2.RIG_MODE_PLAYING, reset | {"run": "a"}),
    ):
        view.show_state(rig_pb2.RigState(rig=campaign.rig, mode=mode, **also))
    view.close()
    at = f"Rig {campaign.rig}: "
    assert lines == [
        f"{at}INTERLOCKED: oil on the floor",
        f"{at}at rest (reset by Ada: oil wiped up)",
        f"{at}playing, run a",
    ]


def test_the_file_is_whole_and_holds_every_curve(live_file, rerun_program, viewer_environment):
    run_rerun(rerun_program, viewer_environment, "rrd", "verify", live_file)
    printed = run_rerun(rerun_program, viewer_environment, "rrd", "print", live_file)
    for entity in (
        "/response/left_vertical/0\\ target",
        "/response/left_vertical/iteration\\ 01",
        "/response/right_vertical/iteration\\ 03",
        "/measured/left_vertical/identify",
        "/measured/left_vertical/0\\ target",
        "/drive/right_vertical/iteration\\ 02",
        "/error/left_vertical",
        "/rms_response/right_vertical",
        "/drive/left_vertical/0\\ limits",
        "/rig/boxes",
        "/rig/cylinders",
        "/rig/spheres",
        "/rig/meshes/0",
        "/rig/lines",
        "/frf/lines",
        "/campaign/status",
    ):
        assert entity in printed, entity


def test_limits_have_a_point_in_each_second_however_long_the_pieces(tmp_path, rerun_program, viewer_environment):
    path = tmp_path / "limits.rrd"
    opened = open_stream("demo", file=path, viewer=None)
    limits = DriveLimits(opened.stream, [array_pb2.Channel(name="left", unit="m", minimum=-1.0, maximum=1.0)])
    for end in (30.0, 45.5, 40.0):
        limits.reach(end)
    close_stream(opened.stream)
    printed = run_rerun(rerun_program, viewer_environment, "rrd", "print", path)
    rows = [int(count) for count in re.findall(r"with (\d+) rows .* - /drive/left/0\\ limits", printed)]
    # The style, the begin, 1 to 30 s, 31 to 45 s and the end.
    assert sum(rows) == 1 + 1 + 30 + 15 + 1


def test_a_block_of_a_time_beyond_all_bounds_costs_a_bounded_number_of_points(tmp_path):
    opened = open_stream("demo", file=tmp_path / "limits.rrd", viewer=None)
    limits = DriveLimits(opened.stream, [array_pb2.Channel(name="left", unit="m", minimum=-1.0, maximum=1.0)])
    limits.reach(1e9)
    close_stream(opened.stream)
    assert (tmp_path / "limits.rrd").stat().st_size < 20e6


def test_a_viewer_that_is_not_there_costs_the_file_nothing(tmp_path, campaign):
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        viewer = f"rerun+http://127.0.0.1:{unused.getsockname()[1]}/proxy"
        start = time.monotonic()
        view = LiveView("demo", file=tmp_path / "demo.rrd", viewer=viewer)
        show_campaign(view, campaign)
        view.close()
    assert time.monotonic() - start < 5
    assert (tmp_path / "demo.rrd").stat().st_size > 0


def test_hostile_channel_names_add_no_level_to_the_tree(tmp_path, campaign, rerun_program, viewer_environment):
    for channels in (campaign.drives, campaign.responses):
        channels[0].name = "a/../b"
    view = LiveView("demo", file=tmp_path / "demo.rrd", viewer=None)
    show_campaign(view, campaign)
    view.close()
    printed = run_rerun(rerun_program, viewer_environment, "rrd", "print", tmp_path / "demo.rrd")
    assert "/response/a\\/..\\/b/iteration\\ 01" in printed


@pytest.fixture
def headless_viewer(live_file, rerun_program, viewer_environment, tmp_path):
    with viewer_of(live_file, rerun_program, viewer_environment, tmp_path) as viewer:
        yield viewer


def not_drawn(picture):
    """Return what is missing in a picture of the viewer."""
    height, width, _ = picture.shape
    # The latest response in each of the two plots on the left, and the orange bars of a channel on the right.
    latest = pixels(picture, LATEST_COLOUR)
    figures = picture[height // 4 : 3 * height // 4, 3 * width // 4 :]
    # The rig above the bars: its box, its piston, its strut.
    rig = picture[height // 14 : height // 4, 3 * width // 4 :]
    drawn = {
        "left plot": latest[:, : width // 3].sum() > 200,
        "right plot": latest[:, width // 3 : 2 * width // 3].sum() > 200,
        "first channel": pixels(figures, CHANNEL_COLOURS[0]).sum() > 200,
        "second channel": pixels(figures, CHANNEL_COLOURS[1]).sum() > 200,
        "specimen": pixels(rig, ROLE_COLOURS[rig_pb2.SHAPE_ROLE_SPECIMEN]).sum() > 30,
        "piston": pixels(rig, ROLE_COLOURS[rig_pb2.SHAPE_ROLE_PISTON]).sum() > 30,
        "strut": pixels(rig, LINE_COLOURS[rig_pb2.LINK_KIND_STRUT]).sum() > 30,
    }
    return [what for what, there in drawn.items() if not there]


def test_the_viewer_draws_curves_and_rig_without_a_click(headless_viewer):
    deadline = time.monotonic() + START_SECONDS
    missing = ["a first picture"]
    # On a busy machine the rig comes seconds after the curves.
    while missing and time.monotonic() < deadline:
        missing = not_drawn(picture_of(headless_viewer))
    assert missing == []


def test_the_view_of_a_log_is_the_view_that_was_watched(
    tmp_path, campaign, rerun_program, viewer_environment, live_file
):
    log = tmp_path / "recording.mcap"
    write_log(log, campaign)
    assert rebuild_view.main([str(log), "--out", str(tmp_path / "again.rrd")]) == 0
    printed = [
        run_rerun(rerun_program, viewer_environment, "rrd", "print", path)
        for path in (live_file, tmp_path / "again.rrd")
    ]
    # Those of the recording; the parts of a layout have names of chance.
    shown = ("/response", "/measured", "/drive", "/rig", "/frf", "/error")
    entities = [{word for word in text.split() if word.startswith(shown)} for text in printed]
    assert entities[0] == entities[1]
    assert "/rig/lines" in " ".join(entities[0])


def test_a_recorder_that_goes_on_with_a_recording_shows_all_of_it(
    tmp_path, campaign, rerun_program, viewer_environment
):
    write_log(tmp_path / "demo.mcap", campaign)
    (tmp_path / "demo.rrd").write_bytes(b"what the recorder showed before it was killed")
    views = LiveViews(tmp_path, files=True, viewer=None)
    views.show_step("demo", campaign.iteration(4, 0.05))
    views.finish("demo")
    views.close(10.0)
    printed = run_rerun(rerun_program, viewer_environment, "rrd", "print", tmp_path / "demo.rrd")
    for entity in ("/response/left_vertical/iteration\\ 01", "/response/left_vertical/iteration\\ 04", "/rig/boxes"):
        assert entity in printed, entity


def test_a_file_that_was_cut_off_is_made_again_when_its_recording_is_closed(
    tmp_path, campaign, rerun_program, viewer_environment, monkeypatch
):
    write_log(tmp_path / "demo.mcap", campaign)
    views = LiveViews(tmp_path, files=True, viewer=None)
    views.show_step("demo", campaign.specification())
    refused = iter([False])
    monkeypatch.setattr("recorder.live.view.close_stream", lambda stream: close_stream(stream) and next(refused, True))
    views.finish("demo")
    views.close(10.0)
    printed = run_rerun(rerun_program, viewer_environment, "rrd", "print", tmp_path / "demo.rrd")
    assert "/response/left_vertical/iteration\\ 03" in printed


def test_views_that_are_over_leave_no_thread_behind(tmp_path, campaign):
    tasks = Path("/proc/self/task")
    if not tasks.is_dir():
        pytest.skip("threads are counted in /proc")

    def of_streams():
        names = []
        for task in tasks.iterdir():
            with suppress(OSError):  # one that ends just now
                names.append((task / "comm").read_text().strip())
        # By Rerun's names for them: the process has others, those of its libraries' pools, that come when they like.
        return Counter({name: names.count(name) for name in ("ChunkBatcher::c", "RecordingStream")})

    def until(condition):
        deadline = time.monotonic() + START_SECONDS
        while not condition():
            assert time.monotonic() < deadline, of_streams()
            time.sleep(0.01)

    before = of_streams()
    views = LiveViews(tmp_path, files=True, viewer=None)
    for number in range(5):
        for message in (campaign.specification(), campaign.description(), campaign.target_in_band()):
            views.show_step(f"view{number}", message)
        if number == 0:
            until(lambda: all(of_streams()[name] > before[name] for name in of_streams()))
        views.finish(f"view{number}")
    until(lambda: of_streams() <= before)
    views.close(10.0)


def test_a_rig_that_cannot_be_drawn_costs_nothing_else(tmp_path, campaign, rerun_program, viewer_environment):
    description = campaign.description()
    description.shapes[0].body = "nobody"
    view = LiveView("demo", file=tmp_path / "demo.rrd", viewer=None)
    view.show_step(campaign.specification())
    view.show_step(description)
    view.show_step(campaign.target_in_band())
    view.show_pose(campaign.poses("demo.i01"))
    view.close()
    printed = run_rerun(rerun_program, viewer_environment, "rrd", "print", tmp_path / "demo.rrd")
    assert "/response/left_vertical/0\\ target" in printed
    assert "/rig/" not in printed
