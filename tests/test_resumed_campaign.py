"""A campaign of a real lab whose iterator is killed in mid playback: resumed, its result is the same bytes."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
import yaml
from typer.testing import CliRunner

import duralab
from duralab.cli.application import app
from duralab_proto.v1 import iterator_pb2


@contextmanager
def new_iterator(endpoint: str, folder: Path) -> Iterator[None]:
    """Start an iterator in place of the one that was killed."""
    file = folder / "iterator.yaml"
    file.write_text(yaml.safe_dump({"bus": {"connect": [endpoint]}, "exit_with_parent": True}))
    command = [sys.executable, "-m", "iterator", "--config", str(file)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as running:
        try:
            yield
        finally:
            running.kill()


def bytes_of(recording: duralab.Recording) -> list[tuple[bytes, bytes]]:
    playbacks = [recording.playback(number) for number in recording.iterations.numbers]
    return [(playback.drive.samples.tobytes(), playback.response.samples.tobytes()) for playback in playbacks]


def command_line(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.stdout + result.stderr


def test_killed_stopped_and_resumed_the_result_is_the_same(
    lab: duralab.Lab, campaign: Callable[..., Path], tmp_path: Path
) -> None:
    endpoint = lab.endpoints[0]
    with duralab.connect(endpoint, out=tmp_path / "out") as other:
        undisturbed = other.run(campaign(name="undisturbed"))
        playing = threading.Event()

        def follow(progress: duralab.RunProgress) -> None:
            if "playing iteration 2" in progress.activity and not playing.is_set():
                playing.set()
                psutil.Process(lab.process_ids["iterator"]).send_signal(signal.SIGKILL)

        with pytest.raises(duralab.LabError, match="iterator"):
            other.run(campaign(name="broken"), on_progress=follow)
        assert playing.is_set()
        with new_iterator(endpoint, tmp_path):
            deadline = time.monotonic() + 60.0
            while ("iterator", "main") not in other._bus.live("iterator") and time.monotonic() < deadline:
                time.sleep(0.05)
            # The rig ramped down when its commander died; somebody has looked at it.
            assert command_line("reset", "front_axle_compliant", "--connect", endpoint)[0] == 0
            code, said = command_line("resume", "broken", "--connect", endpoint, "--out", str(tmp_path / "resumed"))
            assert code in (0, 3), said
            resumed = duralab.open_recording(tmp_path / "resumed" / "recording.mcap")
            assert sorted(path.name for path in (tmp_path / "resumed").iterdir()) == [
                "live.rrd",
                "recording.mcap",
                "report.html",
            ]
            steps = list(resumed.messages(iterator_pb2.IterationStep))
            assert bytes_of(resumed) == bytes_of(undisturbed.recording)
            # Each sample is there once: in the blocks of its run.
            assert not any(step.HasField("drive") or step.HasField("response") for step in steps)
            # A motion that was announced before the kill has a new name; the rig plays each name once.
            assert steps[1].run in ("broken.i02", "broken.i02-2")
            code, said = command_line("resume", "broken", "--connect", endpoint, "--out", str(tmp_path / "no"))
            assert code == 2
            assert "stop.iterations" in said
            # With more playbacks allowed, the same campaign is taken up again by a new one.
            more = other.resume("broken", settings=campaign(name="more", stop__iterations=4))
            assert bytes_of(more.recording)[:3] == bytes_of(undisturbed.recording)
            assert len(more.iterations) == 4
            assert (more.recording.specification.id, more.recording.specification.parent) == ("broken-2", "broken")
            assert command_line("stop", "broken-2", "--connect", endpoint)[1].startswith("broken-2: finished after 4")
