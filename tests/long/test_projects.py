"""A project of events in a real lab: killed at any moment it ends with the same bytes, on one rig or two.

Three events of the shipped project and 3 kills by default; DURALAB_EVENTS=all and DURALAB_KILLS=10 take as many as the
acceptance of the feature does.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import psutil
import pytest
import yaml

import duralab
from duralab.campaign import load_project
from duralab.formats import read_signals
from duralab_proto.v1 import recorder_pb2

KILLS = int(os.environ.get("DURALAB_KILLS", "3"))
SECONDS = 600.0
SHIPPED = Path(duralab.__file__).parent / "campaign" / "shipped_projects" / "front_axle_events.yaml"
EVENTS = ("rough_road", "rough_road_worn", "cobblestones")
if os.environ.get("DURALAB_EVENTS") == "all":
    EVENTS = tuple(yaml.safe_load(SHIPPED.read_text())["events"])


def project(folder: Path, **changes: object) -> Path:
    """Write a project of shipped events."""
    content = yaml.safe_load(SHIPPED.read_text())
    content["events"] = {name: content["events"][name] for name in EVENTS}
    path = folder / "project.yaml"
    path.write_text(yaml.safe_dump(content | changes, sort_keys=False))
    return path


def samples_of(folder: Path, events: Sequence[str] = EVENTS) -> dict[str, list[tuple[bytes, bytes]]]:
    found = {}
    for name in events:
        recording = duralab.open_recording(folder / name / "recording.mcap")
        playbacks = [recording.playback(number) for number in recording.iterations.numbers]
        found[name] = [(one.drive.samples.tobytes(), one.response.samples.tobytes()) for one in playbacks]
    return found


def bytes_of(folder: Path) -> int:
    """Size of the recordings in a folder, as far as they are written."""
    return sum(path.stat().st_size for path in folder.glob("*.mcap"))


def command(path: Path, out: Path) -> subprocess.Popen[str]:
    return started([sys.executable, "-m", "duralab", "run", str(path), "--out", str(out)], folder=path.parent)


def started(arguments: list[str], *, folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=folder, start_new_session=True
    )


def kill_all(process: subprocess.Popen[str]) -> None:
    """Kill the command and every service that it started, at once, as a power cut does."""
    family = [psutil.Process(process.pid)]
    family += family[0].children(recursive=True)
    for one in family:
        one.send_signal(signal.SIGKILL)
    process.communicate()
    psutil.wait_procs(family, timeout=30.0)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed")
    running = command(project(folder), folder / "out")
    said, _ = running.communicate(timeout=SECONDS)
    assert running.returncode == 0, said
    assert f"{len(EVENTS)} of {len(EVENTS)} events reached their targets" in said
    return folder / "out"


def test_one_identification_serves_all_and_everything_is_exported(undisturbed: Path) -> None:
    out = undisturbed
    models, order = set(), (out / "drives" / "front_axle" / "front_axle_events.seq").read_text().splitlines()
    for name in EVENTS:
        recording = duralab.open_recording(out / name / "recording.mcap")
        models.add(recording.model.id)
        assert recording.specification.known.HasField("model") == (name != "rough_road")
        drive = read_signals(out / "drives" / "front_axle" / f"{name}.drv")
        best = recording.playback(recording.status.best_iteration).drive
        # 16 bits of the largest value.
        assert (
            np.abs(drive.samples[:, : best.samples.shape[1]] - best.samples).max() < 1e-4 * np.abs(best.samples).max()
        )
    assert len(models) == 1
    events = yaml.safe_load(SHIPPED.read_text())["events"]
    seconds = {name: events[name]["target"]["road"]["duration"] for name in EVENTS}
    assert order[1:] == [f"{events[name]['repeats']} {seconds[name]:g} {name}.drv" for name in EVENTS]
    page = (out / "report.html").read_text()
    assert all(f">{name}</h2>" in page for name in EVENTS)


@pytest.mark.timeout(2 * SECONDS)
def test_killed_at_seeded_moments_it_ends_with_the_same_bytes(tmp_path: Path, undisturbed: Path) -> None:
    expected, whole = samples_of(undisturbed), sum(bytes_of(undisturbed / name) for name in EVENTS)
    # Moments of the work, not of the clock: a busy machine is killed in the same places.
    path, moments = project(tmp_path), np.random.default_rng(20261125).uniform(0.02, 0.95, KILLS)
    for number, moment in enumerate(moments):
        out = tmp_path / f"out-{number}"
        running = command(path, out)
        until = time.monotonic() + SECONDS
        while bytes_of(out / "recordings") < moment * whole:
            assert running.poll() is None, "the project ended before it was killed"
            assert time.monotonic() < until, "nothing is recorded"
            time.sleep(0.01)
        kill_all(running)
        again = command(path, out)
        said, _ = again.communicate(timeout=SECONDS)
        assert again.returncode == 0, (moment, said)
        assert samples_of(out) == expected, moment


@pytest.mark.timeout(SECONDS)
def test_killed_after_an_event_that_ended_early_it_ends_with_the_same_bytes(tmp_path: Path) -> None:
    plan = yaml.safe_load(project(tmp_path).read_text())
    plan["events"]["rough_road"] |= {"priority": 1, "stop": {"iterations": 1, "damage_budget": 1e-6}}
    for name in EVENTS[1:]:
        plan["events"][name] |= {"priority": 0, "stop": {"iterations": 1}}
    path, out = tmp_path / "early.yaml", tmp_path / "out"
    path.write_text(yaml.safe_dump(plan, sort_keys=False))
    undisturbed = command(path, tmp_path / "undisturbed")
    expected, _ = undisturbed.communicate(timeout=SECONDS)
    assert "- rough_road: The campaign failed while inverting the model: The identification did" in expected
    running, until = command(path, out), time.monotonic() + SECONDS
    while not list((out / "recordings").glob(f"*-{EVENTS[1]}.mcap")):
        assert running.poll() is None, "the project ended before it was killed"
        assert time.monotonic() < until, "nothing is recorded"
        time.sleep(0.01)
    kill_all(running)
    said, _ = command(path, out).communicate(timeout=SECONDS)
    assert "- rough_road: The campaign failed while inverting the model: The identification did" in said
    assert samples_of(out, EVENTS[1:]) == samples_of(tmp_path / "undisturbed", EVENTS[1:])


def test_killed_before_the_first_step_of_an_event_it_makes_the_event_from_the_start(
    tmp_path: Path, undisturbed: Path
) -> None:
    out, last = tmp_path / "out", EVENTS[-1]
    for name in EVENTS[:-1]:
        shutil.copytree(undisturbed / name, out / name)
    content, left = (undisturbed / last / "recording.mcap").read_bytes(), out / "recordings"
    left.mkdir()
    for size in (0, 30, 300):
        shutil.rmtree(out / last, ignore_errors=True)
        (left / f"front_axle_events-{last}.mcap").write_bytes(content[:size])
        again = command(project(tmp_path), out)
        said, _ = again.communicate(timeout=SECONDS)
        assert again.returncode == 0, (size, said)
        assert samples_of(out) == samples_of(undisturbed), size


@pytest.mark.timeout(2 * SECONDS)
def test_a_killed_script_continues_with_the_recordings_of_its_lab(tmp_path: Path, undisturbed: Path) -> None:
    lines = [
        "import duralab",
        "from duralab.campaign import load_project",
        f"project = load_project({str(project(tmp_path))!r})",
        f"with duralab.start(rigs=project.rigs, out={str(tmp_path / 'lab')!r}) as lab:",
        "    print(lab.run_project(project))",
    ]
    script, recordings = tmp_path / "script.py", tmp_path / "lab" / "recordings"
    script.write_text("\n".join(lines) + "\n")
    killed = started([sys.executable, str(script)], folder=tmp_path)
    until = time.monotonic() + SECONDS
    while bytes_of(recordings) < 0.4 * sum(bytes_of(undisturbed / name) for name in EVENTS):
        assert killed.poll() is None, "the project ended before it was killed"
        assert time.monotonic() < until, "nothing is recorded"
        time.sleep(0.01)
    kill_all(killed)
    in_work = max(recordings.glob("*.mcap"), key=lambda path: path.stat().st_mtime).stem
    at = time.time_ns()
    again = started([sys.executable, str(script)], folder=tmp_path)
    said, _ = again.communicate(timeout=SECONDS)
    assert again.returncode == 0, said
    out = tmp_path / "lab" / "front_axle_events"
    assert samples_of(out) == samples_of(undisturbed)
    begun = duralab.open_recording(out / in_work.removeprefix("front_axle_events-") / "recording.mcap").begun
    assert 0 < begun < at, "the event was made again from its beginning"


def test_what_is_there_is_read_and_other_settings_are_refused(undisturbed: Path, tmp_path: Path) -> None:
    out = undisturbed
    before = {name: (out / name / "recording.mcap").stat().st_mtime_ns for name in EVENTS}
    with duralab.start(rigs=("front_axle", "predecessor"), out=tmp_path / "lab") as lab:
        result = lab.run_project(project(tmp_path), out=out)
        assert result.reached
        assert {name: (out / name / "recording.mcap").stat().st_mtime_ns for name in EVENTS} == before
        other = project(tmp_path, update={"kind": "basic_twr", "iteration_gain": 0.5})
        with pytest.raises(duralab.InputError, match=r"made with other settings than the project has for event"):
            lab.run_project(other, out=out)


@pytest.mark.timeout(SECONDS)
def test_two_rigs_share_the_events_and_a_missed_one_is_told(tmp_path: Path) -> None:
    plan = yaml.safe_load(project(tmp_path).read_text())
    compliant = {"rig": "front_axle_compliant"}
    plan["excitation"]["rms"] = {name: 0.4 * level for name, level in plan["excitation"]["rms"].items()}
    plan["events"]["cobblestones"] |= compliant | {"stop": {"iterations": 1}}
    path = tmp_path / "two.yaml"
    path.write_text(yaml.safe_dump(plan))
    found = load_project(path)
    with duralab.start(rigs=found.rigs, out=tmp_path / "out") as lab:
        result = lab.run_project(found)
    rows = {event.event.name: event for event in result.events}
    assert rows["cobblestones"].started_from == ""
    assert not rows["cobblestones"].reached
    assert not result.reached
    assert "not cobblestones" in result.sentence
    drives = tmp_path / "out" / "front_axle_events" / "drives"
    assert not (drives / "front_axle_compliant").exists()
    assert result.order_path == drives / "front_axle" / "front_axle_events.seq"


@pytest.mark.timeout(SECONDS)
@pytest.mark.parametrize("connected", [False, True], ids=["own lab", "connected lab"])
def test_a_rig_is_identified_once_also_where_events_miss_their_targets_or_end_early(
    tmp_path: Path, *, connected: bool
) -> None:
    plan = yaml.safe_load(project(tmp_path).read_text())
    # The first one ends early: its budget of damage leaves no room for a playback after the identification.
    plan["events"]["rough_road"] |= {"priority": 2, "stop": {"iterations": 2, "damage_budget": 1e-6}}
    plan["events"]["rough_road_worn"] |= {"priority": 1, "stop": {"iterations": 1}}
    plan["events"]["cobblestones"] |= {"priority": 0, "stop": {"iterations": 1}}
    path = tmp_path / "missed.yaml"
    path.write_text(yaml.safe_dump(plan | {"accept": plan["accept"] | {"relative_rms_error": 1e-4}}))
    found = load_project(path)
    stale = tmp_path / "out" / "front_axle_events" / "drives" / "front_axle" / "front_axle_events.seq"
    stale.parent.mkdir(parents=True)
    stale.write_text("1 10 rough_road.drv\n")
    stale.with_suffix(".drv").write_bytes(b"of an earlier run")
    with (
        duralab.start(rigs=found.rigs, out=tmp_path / "out") as own,
        duralab.connect(own.endpoints[0]) if connected else nullcontext(own) as lab,
    ):
        result = lab.run_project(found, out=tmp_path / "out" / "front_axle_events")
    first, *others = result.events
    assert "damage" in first.error
    assert [event.started_from for event in result.events] == ["", "rough_road", "rough_road"]
    assert all(event.result is not None and not event.reached for event in others)
    for event in others:
        recording = event.result.recording
        assert recording.specification.known.model_source == "front_axle_events-rough_road"
        # One playback, and no run of an identification.
        assert len(list(recording.messages(recorder_pb2.RunPlanned))) == 1
    assert result.order_path is None
    assert "0 of 3 events reached their targets" in result.sentence
    assert "no drives are written" in result.sentence
    assert list(stale.parent.iterdir()) == []
