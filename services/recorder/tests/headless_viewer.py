"""A real Rerun viewer without a screen, and the pictures that it takes."""

import socket
import subprocess
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

START_SECONDS = 60.0


@dataclass(frozen=True)
class HeadlessViewer:
    """A running viewer, where it answers, and where its log and its pictures go."""

    process: subprocess.Popen
    address: str
    folder: Path


@contextmanager
def viewer_of(file, program, environment, folder):
    """Show a file."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    arguments = [str(file), "--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", "1600x1000"]
    with (folder / "viewer.log").open("w") as log:
        process = subprocess.Popen([program, *arguments], env=environment, stdout=log, stderr=log)
        try:
            yield HeadlessViewer(process, f"rerun+http://127.0.0.1:{port}/proxy", folder)
        finally:
            process.kill()
            process.wait()


def picture_of(viewer):
    """Return a picture (height, width, 3); skips the test on a machine without Vulkan, which ends the viewer."""
    from PIL import Image

    path = viewer.folder / "view.png"
    if not _taken(viewer, path):
        log = (viewer.folder / "viewer.log").read_text()
        pytest.skip(f"Rerun cannot draw here (is mesa-vulkan-drivers installed?): {log[-300:]!r}")
    return np.asarray(Image.open(path).convert("RGB")).astype(float)


def _taken(viewer, path):
    from rerun.experimental import ViewerClient

    deadline = time.monotonic() + START_SECONDS
    while viewer.process.poll() is None and time.monotonic() < deadline:
        try:
            client = ViewerClient.connect(viewer.address)
            # The first frames show an empty window while the file loads.
            time.sleep(2.0)
            client.save_screenshot(str(path))
        except ConnectionError:
            time.sleep(0.2)
        else:
            return True
    return False


def pixels(picture, colour, *, within=40):
    """Return which pixels (height, width) are of a colour, whatever light falls on it."""
    bright = picture.max(axis=-1, keepdims=True)
    hue = np.where(bright > 60, picture * (max(colour) / np.maximum(bright, 1)), 0.0)
    return (np.abs(hue - np.array(colour)) < within).all(axis=-1) & (bright[..., 0] > 60)
