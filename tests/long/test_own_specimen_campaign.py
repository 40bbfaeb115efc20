"""The campaign of the guide to one's own specimen, run as the page says, on a port of its own."""

import shlex
import subprocess
import sys
import time
from pathlib import Path

from documented import PORT, fences

import duralab
from duralab_bus import open_bus

PAGE = "docs/guides/own-specimen.md"


def commands(folder, endpoint, *, background):
    """Return the commands of the campaign's section, for this Python and this port."""
    text = Path(duralab.__file__).parents[2].joinpath(PAGE).read_text(encoding="utf-8")
    begin = text[: text.index("## 5. ")].count("\n")
    blocks = [fence for fence in fences(PAGE) if fence.language == "console" and fence.line > begin]
    told = [line for fence in blocks if ("background" in fence.options) == background for line in fence.commands]
    programs = {"duralab": [sys.executable, "-m", "duralab"], "python": [sys.executable]}
    return [
        [*programs[program], *arguments]
        for program, *arguments in (shlex.split(line.replace(PORT, endpoint)) for line in told)
    ]


def test_a_campaign_runs_on_ones_own_specimen_as_the_guide_says(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with open_bus(service="client") as bus:
        endpoint = bus.listening[0]
    for fence in fences(PAGE):
        if "file" in fence.options:
            (tmp_path / fence.options["file"]).write_text(fence.text.replace(PORT, endpoint))
    up, serve = commands(tmp_path, endpoint, background=True)
    started = [subprocess.Popen(up, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)]
    try:
        assert "The lab is up at" in started[0].stdout.readline()
        started.append(subprocess.Popen(serve, cwd=tmp_path, stderr=subprocess.DEVNULL))
        with duralab.connect(endpoint) as lab:
            deadline = time.monotonic() + 60.0
            while "quarter_car" not in lab.rig_names():
                assert time.monotonic() < deadline
                time.sleep(0.2)
        for command in commands(tmp_path, endpoint, background=False):
            done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=200, check=False)
            assert done.returncode == 0, done.stderr
    finally:
        for process in reversed(started):
            process.terminate()
        for process in started:
            process.wait(60.0)
            if process.stdout is not None:
                process.stdout.close()
    recording = duralab.open_recording(tmp_path / "out" / "quarter" / "recording.mcap")
    assert recording.rig.rig == "quarter_car"
    # Exit code 0 says that the target was reached; the error has to come down on the way.
    assert recording.iterations.overall[-1] < recording.iterations.overall[0] / 2
