"""A campaign that does not end well: what was committed until then is where its sentence says, in every such case."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import duralab

RIG = "front_axle_compliant"
ROAD = {"iso_class": "C", "seed": 1, "duration": 60.0}
"""Long enough that what is done to a playback falls into it, wherever this machine is busy."""


def named_in(sentence: str) -> Path:
    found = re.search(r"What was played until then is in (?P<path>\S+\.mcap);", sentence)
    assert found is not None, sentence
    return Path(found["path"])


def holds_playbacks(path: Path, *, at_least: int, report: Path) -> None:
    """Check that a recording holds what was committed, every sample of its playbacks too."""
    recording = duralab.open(path)
    assert recording.model is not None
    assert len(recording.iterations) >= at_least
    for number in recording.iterations.numbers:
        playback = recording.playback(number)
        drive, response = recording.signal(playback.run)
        np.testing.assert_array_equal(drive.samples, playback.drive.samples)
        np.testing.assert_array_equal(response.samples, playback.response.samples)
    if at_least:
        assert duralab.write_report(recording, report).stat().st_size


@pytest.mark.parametrize("times", [1, 2])
def test_interrupted_once_or_twice_in_an_iteration_what_was_played_stays(
    times: int, campaign: Callable[..., Path], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "duralab", "run", str(campaign(target__road=ROAD)), "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        for line in running.stdout:
            if "playing iteration 2" in line:
                break
        for _ in range(times):
            running.send_signal(signal.SIGINT)
            time.sleep(0.1)
        _, errors = running.communicate(timeout=120)
    assert running.returncode == 130
    assert errors.startswith("Interrupted; ")
    assert errors.count("\n") == 1
    kept = named_in(errors)
    if times == 1:
        assert kept == out / "recording.mcap"
        assert sorted(path.name for path in out.iterdir()) == ["live.rrd", "logs", "recording.mcap"]
    assert kept.is_relative_to(out)
    holds_playbacks(kept, at_least=1, report=tmp_path / "report.html")


def end_campaigns_badly(plan: Path, folder: Path) -> dict[str, tuple[str, Path]]:
    """End campaigns badly in one lab without a place of its own: by kind of end its sentence and its folder, if any."""
    cancel, deadline = threading.Event(), 0.0
    told: dict[str, tuple[str, Path]] = {}

    def enough(progress: duralab.RunProgress) -> None:
        if "playing iteration 2" in progress.activity:
            cancel.set()

    def dawdle(progress: duralab.RunProgress) -> None:
        if "playing iteration 1" in progress.activity:
            time.sleep(max(0.0, deadline - time.monotonic()))

    def break_off(progress: duralab.RunProgress) -> None:
        if "playing iteration 1" in progress.activity:
            lab.stop_rig(RIG, reason="the strut looks hot")

    def end(kind: str, error: type[duralab.LabError], run: Callable[..., object], **how: Any) -> None:
        with pytest.raises(error) as caught:
            run(plan, **how)
        told[kind] = (str(caught.value), how.get("out", Path()))
        lab.reset(RIG)

    with duralab.start(rigs=(RIG, "predecessor")) as lab:
        end("stopped", duralab.StoppedError, lab.run, on_progress=enough, cancel=cancel)
        end("faulted", duralab.CampaignFaultError, lab.run, on_progress=break_off)
        out = folder / "given"
        end("given a folder", duralab.CampaignFaultError, lab.run, on_progress=break_off, out=out)
        before = (out / "recording.mcap").read_bytes()
        end("given it again", duralab.CampaignFaultError, lab.run, on_progress=break_off, out=out)
        assert (out / "recording.mcap").read_bytes() == before
        with duralab.connect(lab.endpoints[0]) as other:
            deadline = time.monotonic() + 10.0
            late = {"on_progress": dawdle, "timeout_seconds": 10.0}
            end("late", duralab.LabTimeoutError, other.run, out=folder / "late", **late)
            end("joined", duralab.CampaignFaultError, other.run, on_progress=break_off)
    return told


@pytest.fixture(scope="module")
def bad_ends(tmp_path_factory: pytest.TempPathFactory, short_document: dict[str, Any]) -> dict[str, tuple[str, Path]]:
    """Return what `end_campaigns_badly` does."""
    folder = tmp_path_factory.mktemp("ends")
    document = deepcopy(short_document)
    document["stop"]["iterations"] = 9
    (folder / "campaign.yaml").write_text(yaml.safe_dump(document))
    with pytest.MonkeyPatch.context() as patch:
        (folder / "system").mkdir()
        patch.setattr("tempfile.tempdir", str(folder / "system"))
        # The lab does not know whether another session fetched what that one asked for.
        with pytest.warns(UserWarning, match=r"The recording 'front_axle_demo-5' is in .*/recordings/.*demo-5\.mcap"):
            return end_campaigns_badly(folder / "campaign.yaml", folder)


def test_a_stopped_campaign_of_a_lab_without_a_place_stays_where_it_was_written(bad_ends, tmp_path: Path) -> None:
    sentence, _ = bad_ends["stopped"]
    holds_playbacks(named_in(sentence), at_least=1, report=tmp_path / "report.html")
    assert f"`duralab resume {named_in(sentence)}` continues it." in sentence


@pytest.mark.parametrize("kind", ["faulted", "given a folder", "given it again"])
def test_an_early_fault_leaves_its_proof(bad_ends, kind: str, tmp_path: Path) -> None:
    sentence, out = bad_ends[kind]
    assert "the strut looks hot" in sentence
    kept = named_in(sentence)
    # What is there of another campaign gives way to none that ended badly.
    assert (kept == out / "recording.mcap") is (kind == "given a folder")
    holds_playbacks(kept, at_least=0, report=tmp_path / "report.html")
    recording = duralab.open(kept)
    assert recording.closed is not None
    assert "the strut looks hot" in recording.closed.reason
    assert recording.responses(recording.runs[0]).sizes["time"] > 0
    # On a busy machine the stop may come late, in a later playback or between two of them.
    last = int(recording.runs[-1].removeprefix(f"{recording.specification.id}.i"))
    assert last - len(recording.iterations) in (0, 1)


def test_a_campaign_past_its_time_is_brought_to_whoever_asked_for_it(bad_ends, tmp_path: Path) -> None:
    sentence, out = bad_ends["late"]
    assert named_in(sentence) == out / "recording.mcap"
    holds_playbacks(out / "recording.mcap", at_least=0, report=tmp_path / "report.html")


def test_a_lab_that_goes_on_keeps_what_nobody_gave_a_place(bad_ends) -> None:
    sentence, _ = bad_ends["joined"]
    assert "stays with the recorder of the lab as 'front_axle_demo-6'" in sentence
