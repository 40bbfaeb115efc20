"""What an engineer sees: a recording whose live view is lost, opened as a page in a real browser."""

import io
import time

import numpy as np
import pytest
import synthetic_campaign
from browser import Browser, RefusedError, browser_program
from PIL import Image

from duralab.errors import LabError
from duralab.processes import Viewer, rebuilt_view
from duralab_proto.arrays import to_array
from duralab_proto.v1 import rig_pb2

#: As the live view draws them: the newest response, and a part of the specimen.
LATEST = (232, 119, 34)
SPECIMEN = (110, 160, 215)
SECONDS = 300.0
STILL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def view(tmp_path_factory):
    made = synthetic_campaign.make(seconds=6.0, iterations=3)
    messages = synthetic_campaign.steps(made)
    for message in messages:
        if isinstance(message, rig_pb2.RigDescription):
            message.bodies.append("knuckle")
            message.rest_poses.CopyFrom(to_array(STILL[None]))
            box = rig_pb2.BoxShape(x=1.0, y=1.0, z=1.0)
            message.shapes.append(
                rig_pb2.RigShape(
                    name="knuckle",
                    body="knuckle",
                    role=rig_pb2.SHAPE_ROLE_SPECIMEN,
                    pose=to_array(STILL),
                    box=box,
                )
            )
    folder = tmp_path_factory.mktemp("view")
    return rebuilt_view(
        synthetic_campaign.write(folder / "recording.mcap", messages), folder / "live.rrd", report=print
    )


def of_colour(picture, colour):
    """Count the pixels of a colour, whatever light falls on it."""
    bright = picture.max(axis=-1, keepdims=True)
    hue = picture * (max(colour) / np.maximum(bright, 1.0))
    return int(((np.abs(hue - np.array(colour)) < 40).all(axis=-1) & (bright[..., 0] > 60)).sum())


@pytest.mark.skipif(browser_program() is None, reason="no chromium here; apt-get install chromium")
def test_a_browser_draws_curves_and_rig_of_a_recording_without_a_click(view, tmp_path):
    program = browser_program()
    assert program is not None
    curves, rig, content, refused = 0, 0, b"", ""
    with (
        Viewer(port=0, web_port=0, native=False, file=view) as viewer,
        Browser(program, tmp_path / "profile", webgl=True) as page,
    ):
        page.call("Page.navigate", url=viewer.page)
        deadline = time.monotonic() + SECONDS
        while time.monotonic() < deadline and not (curves > 200 and rig > 200):
            time.sleep(2.0)
            try:
                content = page.picture()
            except RefusedError as error:  # it may be too busy to take one
                refused = str(error)
                continue
            picture = np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(float)
            width = picture.shape[1]
            curves, rig = of_colour(picture[:, : width // 2], LATEST), of_colour(picture[:, 3 * width // 4 :], SPECIMEN)
    (tmp_path / "page.png").write_bytes(content)
    assert curves > 200, refused
    assert rig > 200, refused


def test_a_recording_that_cannot_be_shown_is_told(tmp_path):
    path = tmp_path / "recording.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    with pytest.raises(LabError, match="ends within its first record"):
        rebuilt_view(path, tmp_path / "live.rrd", report=print)
