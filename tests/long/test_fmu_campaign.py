"""The guide to a rig in an FMU, followed to the letter; a crash of the FMU in mid campaign, and the contract."""

from __future__ import annotations

import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import yaml
from documented import PORT, ROOT, fences, free_endpoint

import duralab
from duralab.conformance import Outcome, check_rig
from duralab.lab import join_bus

sys.path.insert(0, str(ROOT / "examples" / "fmu_rig"))

PAGE = "docs/guides/fmu-rig.md"
WAIT = 60.0


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)


class ServedLab:
    """The lab of the page, with the FMU's rig_sim beside it."""

    def __init__(self, folder: Path, fmi: int) -> None:
        import build_fmu

        self.folder, self.endpoint = folder, free_endpoint()
        build_fmu.build(folder / "two_post.fmu", fmi=fmi)
        for fence in fences(PAGE):
            if "file" in fence.options:
                (folder / fence.options["file"]).write_text(fence.text.replace(PORT, self.endpoint))
        programs = {"duralab": [sys.executable, "-m", "duralab"], "python": [sys.executable]}
        consoles = [fence for fence in fences(PAGE) if fence.language == "console"]
        self.background, self.commands = (
            [
                [*programs[program], *arguments]
                for fence in consoles
                if ("background" in fence.options) == background
                for program, *arguments in (shlex.split(line.replace(PORT, self.endpoint)) for line in fence.commands)
            ]
            for background in (True, False)
        )
        up, serve = self.background
        self.up = subprocess.Popen(up, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert self.up.stdout is not None
        assert "The lab is up at" in self.up.stdout.readline()
        self.rig = subprocess.Popen(serve, cwd=folder, stderr=subprocess.DEVNULL)
        with duralab.connect(self.endpoint) as lab:
            deadline = time.monotonic() + WAIT
            while "two_post" not in lab.rig_names():
                assert time.monotonic() < deadline
                time.sleep(0.1)

    def fmu_processes(self) -> list[psutil.Process]:
        return [child for child in psutil.Process(self.rig.pid).children() if "child.py" in " ".join(child.cmdline())]

    def close(self) -> None:
        for process in (self.rig, self.up):
            process.terminate()
            process.wait(WAIT)
        if self.up.stdout is not None:
            self.up.stdout.close()


@pytest.fixture(params=[2, 3])
def served(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedLab]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    lab = ServedLab(tmp_path, request.param)
    yield lab
    lab.close()


def test_a_campaign_runs_as_the_guide_says_and_a_crash_of_the_fmu_does_not_spoil_it(served: ServedLab) -> None:
    folder = served.folder
    for command in served.commands:
        done = run(command, folder)
        assert done.returncode == 0, done.stdout + done.stderr
    undisturbed = duralab.open_recording(folder / "out" / "beam" / "recording.mcap")
    worst = float(undisturbed.iterations.judged_error[-1].max())
    sys.stdout.write(f"worst error {100 * worst:.2f} % after {len(undisturbed.iterations.numbers)} playbacks\n")
    assert worst <= 0.05

    # The same campaign, and the FMU's process is killed in its second playback.
    document = yaml.safe_load((folder / "beam.yaml").read_text())
    (folder / "broken.yaml").write_text(yaml.safe_dump({**document, "name": "broken"}))
    killed: list[psutil.Process] = []
    seen = threading.Event()

    def follow(progress: duralab.RunProgress) -> None:
        if "iteration 2" in progress.activity:
            seen.set()

    def kill() -> None:
        # Its process lives for some tenths of a second only.
        assert seen.wait(WAIT)
        deadline = time.monotonic() + WAIT
        while not killed and time.monotonic() < deadline:
            killed.extend(served.fmu_processes())
            time.sleep(0.002)
        for process in killed:
            process.kill()

    with duralab.connect(served.endpoint, out=folder / "other") as lab:
        killer = threading.Thread(target=kill)
        killer.start()
        with pytest.raises(duralab.LabError, match=r"two_post\.fmu crashed \(SIGKILL\)"):
            lab.run(folder / "broken.yaml", on_progress=follow)
        killer.join()
        assert killed
        assert served.rig.poll() is None
        state = lab.state("two_post")
        assert "crashed (SIGKILL)" in state.reason
        lab.reset("two_post")
        resumed = lab.resume("broken")
        assert served.fmu_processes() == []
    assert float(resumed.iterations.judged_error[-1].max()) <= 0.05
    assert [p.tobytes() for p in drives(resumed.recording)] == [p.tobytes() for p in drives(undisturbed)]


def drives(recording: duralab.Recording) -> list:
    return [recording.playback(number).response.samples for number in recording.iterations.numbers]


def test_it_keeps_the_contract(served: ServedLab) -> None:
    with join_bus(served.endpoint) as bus:
        findings = check_rig(bus, "two_post", seconds=4.0)
    assert [finding for finding in findings if finding.outcome is Outcome.FAILED] == []
