"""A campaign is resumed from nothing but its file: in a private lab, with real processes, the file unchanged."""

from __future__ import annotations

import hashlib
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
import yaml

import duralab

SECONDS = 300.0


def steps_of(recording: duralab.Recording) -> list[tuple[bytes, bytes]]:
    playbacks = [recording.playback(number) for number in recording.iterations.numbers]
    return [(playback.drive.samples.tobytes(), playback.response.samples.tobytes()) for playback in playbacks]


def state_of(folder: Path) -> dict[str, tuple[str, int]]:
    """Every file of a folder: what is in it, and when it was written last."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {
        path.name: (hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_mtime_ns)
        for path in files
        if "logs" not in path.parts
    }


def command_line(*arguments: str, folder: Path) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-m", "duralab", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


RIGS = ("front_axle_compliant", "predecessor")


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory, short_document: dict[str, object]) -> Path:
    """The folder of a short campaign that was run to its end, in a lab that has ended."""
    folder = tmp_path_factory.mktemp("first")
    (folder / "campaign.yaml").write_text(yaml.safe_dump(short_document | {"name": "short"}))
    code, said = command_line("run", "campaign.yaml", folder=folder)
    assert code in (0, 3), said
    return folder / "out" / "short"


def test_a_file_is_resumed_with_the_keys_that_change(first: Path, tmp_path: Path) -> None:
    before = state_of(first)
    (tmp_path / "partial.yaml").write_text("update: {caution: 2.0}\nstop: {iterations: 4}\n")
    given = first / "recording.mcap"
    code, said = command_line("resume", str(given), "--settings", "partial.yaml", folder=tmp_path)
    assert code in (0, 3), said
    out = tmp_path / "out" / "short-2"
    assert {path.name for path in out.iterdir()} == {"recording.mcap", "live.rrd", "report.html", "logs"}
    assert state_of(first) == before
    parent, child = duralab.open(given), duralab.open(out / "recording.mcap")
    wanted, kept = child.specification, parent.specification
    assert (wanted.id, wanted.parent, wanted.parent_iteration) == ("short-2", "short", 3)
    assert len(child.iterations) == 4
    assert steps_of(child)[:3] == steps_of(parent)
    # Only what was given differs.
    assert wanted.stop.iterations == 4
    assert wanted.update.secant.caution == 2.0
    wanted.stop.iterations = kept.stop.iterations
    wanted.update.secant.caution = kept.update.secant.caution
    assert (wanted.update, wanted.stop) == (kept.update, kept.stop)
    recorded = yaml.safe_load(child.specification.scenario)
    assert recorded["update"] == yaml.safe_load(kept.scenario)["update"] | {"secant": {"caution": 2.0}}
    assert (out / "report.html").stat().st_size > 100_000
    # What was resumed can be resumed again, from its own file.
    (tmp_path / "more.yaml").write_text("stop: {iterations: 5}\n")
    again = [str(out / "recording.mcap"), "--settings", "more.yaml"]
    code, said = command_line("resume", *again, folder=tmp_path)
    assert code in (0, 3), said
    grandchild = duralab.open(tmp_path / "out" / "short-3" / "recording.mcap").specification
    assert (grandchild.parent, grandchild.update.secant.caution) == ("short-2", 2.0)


def test_a_recording_that_a_kill_broke_off_goes_on_in_a_copy_of_it(
    first: Path, campaign: Callable[..., Path], tmp_path: Path
) -> None:
    def follow(progress: duralab.RunProgress) -> None:
        if "playing iteration 2" in progress.activity:
            psutil.Process(lab.process_ids["recorder"]).send_signal(signal.SIGKILL)

    with pytest.raises(duralab.LabError, match="recorder"), duralab.start(tmp_path / "broken", rigs=RIGS) as lab:
        lab.run(campaign(name="short"), out=tmp_path / "broken", on_progress=follow)
    given = tmp_path / "broken" / "recordings" / "short.mcap"
    before = state_of(tmp_path / "broken")
    assert not duralab.open(given).whole
    with duralab.start(tmp_path / "mended", rigs=RIGS) as lab:
        result = lab.resume(given, out=tmp_path / "mended")
        result.report()
    assert state_of(tmp_path / "broken") == before
    assert result.recording.specification.id == "short"
    assert steps_of(result.recording) == steps_of(duralab.open(first / "recording.mcap"))
    assert {path.name for path in (tmp_path / "mended").iterdir() if path.suffix != ".rrd"} >= {
        "recording.mcap",
        "report.html",
    }
    assert not (tmp_path / "mended" / "recordings").exists()


def test_what_cannot_be_resumed_from_a_file_is_refused_before_a_lab_starts(first: Path, tmp_path: Path) -> None:
    given = str(first / "recording.mcap")
    before = state_of(first)
    (tmp_path / "settings.yaml").write_text("update: {gane: 0.5}\n")
    (tmp_path / "gain.yaml").write_text("update: {iteration_gain: 7}\n")
    for arguments, sentence in (
        ([str(tmp_path / "no.mcap")], "no.mcap"),
        ([given, "--connect", "tcp/127.0.0.1:1"], "in a private lab; leave it out"),
        ([given, "--settings", "settings.yaml"], "unknown key 'gane' in update"),
        ([given, "--settings", "gain.yaml"], "update.iteration_gain is 7"),
        ([given, "--out", str(first), "--from", "1"], "is the file that is read"),
        ([given, "--out", str(first), "--from", "1", "--replace"], "is the file that is read"),
    ):
        code, said = command_line("resume", *arguments, folder=tmp_path)
        assert code == 2, said
        assert sentence in " ".join(said.split()), said
        assert not (tmp_path / "out").exists()
    assert state_of(first) == before
    with (
        duralab.start(tmp_path / "standing") as standing,
        duralab.connect(standing.endpoints[0]) as other,
        pytest.raises(
            duralab.InputError, match=r"name 'short' where the lab's catalogue lists it, or use a private lab"
        ),
    ):
        other.resume(given)
