from __future__ import annotations

import socket
import subprocess
import time

import numpy as np
import pytest

from duralab_proto.v1 import iterator_pb2
from recorder.live_view import LiveView

START_SECONDS = 60.0


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
        view.show_step(campaign.iteration(iteration, error))
    view.show_step(campaign.status(iterator_pb2.CAMPAIGN_PHASE_FINISHED))


@pytest.fixture
def live_file(tmp_path, campaign):
    path = tmp_path / "demo.rrd"
    view = LiveView("demo", file=path, viewer=None)
    show_campaign(view, campaign)
    view.close()
    return path


def run_rerun(program, environment, *arguments):
    return subprocess.run(
        [program, *map(str, arguments)], env=environment, capture_output=True, text=True, timeout=120, check=True
    ).stdout


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
        "/frf/lines",
        "/campaign/status",
    ):
        assert entity in printed, entity


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
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    arguments = [str(live_file), "--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", "1600x1000"]
    with (tmp_path / "viewer.log").open("w") as log:
        process = subprocess.Popen([rerun_program, *arguments], env=viewer_environment, stdout=log, stderr=log)
        try:
            yield process, f"rerun+http://127.0.0.1:{port}/proxy"
        finally:
            process.kill()
            process.wait()


def take_picture(process, address, path):
    """Return whether a picture was taken; a machine without Vulkan ends the viewer instead."""
    from rerun.experimental import ViewerClient

    deadline = time.monotonic() + START_SECONDS
    while process.poll() is None and time.monotonic() < deadline:
        try:
            client = ViewerClient.connect(address)
            # The first frames show an empty window while the file loads.
            time.sleep(2.0)
            client.save_screenshot(str(path))
        except ConnectionError:
            time.sleep(0.2)
        else:
            return True
    return False


def test_the_viewer_draws_the_curves(headless_viewer, tmp_path):
    from PIL import Image

    path = tmp_path / "view.png"
    if not take_picture(*headless_viewer, path):
        log = (tmp_path / "viewer.log").read_text()
        pytest.skip(f"Rerun cannot draw here (is mesa-vulkan-drivers installed?): {log[-300:]!r}")
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    red, green, blue = picture[..., 0], picture[..., 1], picture[..., 2]
    orange = (red > 180) & (abs(green - 110) < 50) & (blue < 90)
    height, width = orange.shape
    # The latest response in each of the two plots on the left, and the orange bars of a channel on the right.
    assert orange[:, : width // 3].sum() > 200
    assert orange[:, width // 3 : 2 * width // 3].sum() > 200
    assert orange[: height // 2, 3 * width // 4 :].sum() > 200
