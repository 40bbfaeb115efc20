"""Every script of `examples/` is run as a user runs it, against one lab, in an empty folder."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import duralab
from duralab.formats import read_signals

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
BARE = EXAMPLES / "bare_zenoh"
RUST = BARE / "rust"
LONGEST = 45

# What a reader of its output must find; `run_a_campaign` leaves the recording that `read_a_recording` reads.
PRINTS = {
    "list_rigs": (r"front_axle_compliant .*1000 Hz", r"predecessor is idle"),
    "play_a_file": (r"4096 samples at 1000 Hz", r"heave\.rsp"),
    "identify_and_plot": (r"independent averages", r"largest at [\d.]+ Hz"),
    "own_algorithm": (r"gain 0\.9: relative RMS error",),
    "watch_a_campaign": (r"front_axle_compliant is playing", r"finished after 3 iterations", r"largest force \d{4,} N"),
    "stop_a_playback": (
        r"longer than the 0\.5 s allowed",
        r"interlocked: the strut looks hot",
        r"front_axle_compliant is idle",
    ),
    "reproduce_a_manoeuvre": (
        r"playback 1: error",
        r"playback \d: error below 0\.8 Hz 0\.0[01]\d, in the whole band 0\.0",
    ),
    "compare_algorithms": (r"secant: overall", r"basic_twr: overall", r"left vertical"),
    "two_rigs_at_once": (r"CancelledError", r"front_axle_compliant is interlocked", r"front_axle_compliant is idle"),
}


def run(script: Path, *arguments: str, folder: Path) -> str:
    finished = subprocess.run(
        [sys.executable, "-W", "error", str(script), *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONUTF8": "1"},
        capture_output=True,
        text=True,
        timeout=170,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    return finished.stdout


@pytest.mark.parametrize("name", PRINTS)
def test_an_example_runs_and_prints_what_it_promises(lab, name: str, tmp_path: Path):
    printed = run(EXAMPLES / f"{name}.py", lab.endpoints[0], folder=tmp_path)
    for expected in PRINTS[name]:
        assert re.search(expected, printed), printed


def test_a_campaign_is_run_and_its_recording_read(lab, tmp_path: Path):
    assert "The target was reached" in run(EXAMPLES / "run_a_campaign.py", lab.endpoints[0], folder=tmp_path)
    out = tmp_path / "out" / "run"
    assert (out / "report.html").is_file()
    assert read_signals(out / "best.drv").samples.shape[0] == 6
    printed = run(EXAMPLES / "read_a_recording.py", str(out / "recording.mcap"), folder=tmp_path)
    figures = re.search(r"^\[([\d. ]+)\]$", printed, flags=re.M)
    assert figures is not None, printed
    expected = duralab.open(out / "recording.mcap").iterations.relative_rms_error[:, 0]
    np.testing.assert_allclose([float(figure) for figure in figures[1].split()], expected, atol=5.1e-4)


def test_there_are_eleven_examples_each_short_explained_and_run_here():
    scripts = sorted(EXAMPLES.glob("*.py"))
    assert {script.stem for script in scripts} == {*PRINTS, "run_a_campaign", "read_a_recording"}
    assert len(scripts) == 11
    for script in scripts:
        text = script.read_text(encoding="utf-8")
        assert text.count("\n") <= LONGEST, script.name
        assert script.name in (ast.get_docstring(ast.parse(text)) or ""), script.name


def test_bare_scripts_need_zenoh_and_the_generated_messages_and_nothing_else_of_ours():
    scripts = sorted(BARE.glob("*.py"))
    assert [script.stem for script in scripts] == ["follow_events", "list_rigs"]
    for script in scripts:
        tree = ast.parse(script.read_text(encoding="utf-8"))
        modules = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
        modules |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert modules - sys.stdlib_module_names == {"zenoh", "duralab_proto.v1"}


def test_a_bare_script_lists_the_rigs(lab, tmp_path: Path):
    printed = run(BARE / "list_rigs.py", lab.endpoints[0], folder=tmp_path)
    assert re.search(r"^front_axle_compliant: .*, 1000 Hz$", printed, flags=re.M)
    assert "  left_vertical: -0.115 to 0.115 m\n" in printed


def test_a_bare_script_follows_what_happens(lab, tmp_path: Path):
    command = [sys.executable, "-W", "error", str(BARE / "follow_events.py"), lab.endpoints[0], "60"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as script:
        assert script.stdout is not None
        try:
            assert script.stdout.readline() == "listening\n"
            seen: list[str] = []
            # It meets the rig within a second or two: played until it has.
            for attempt in range(20):
                lab.play("front_axle_compliant", np.zeros((6, 1000)), run=f"followed-{attempt}", real_time=True)
                if lab.state("front_axle_compliant").resting and _ready(script.stdout):
                    break
            while not any("the last" in line for line in seen):
                seen.append(script.stdout.readline())
            assert any("/signal/followed-" in line and "samples from" in line for line in seen), seen
        finally:
            script.kill()


def _ready(stream) -> bool:
    import select

    return bool(select.select([stream], [], [], 0.0)[0])


def test_the_rust_client_speaks_with_the_zenoh_of_the_lock_and_asks_for_exact_versions():
    manifest = tomllib.loads((RUST / "Cargo.toml").read_text())
    locked = re.search(r"(?m)^eclipse-zenoh==(\S+)", (ROOT / "requirements.lock").read_text())
    assert locked is not None
    assert manifest["dependencies"]["zenoh"]["version"] == f"={locked[1]}"
    asked = {**manifest["dependencies"], **manifest["build-dependencies"]}
    versions = {name: told if isinstance(told, str) else told["version"] for name, told in asked.items()}
    assert {name: version for name, version in versions.items() if not re.fullmatch(r"=\d+\.\d+\.\d+", version)} == {}


def test_the_rust_client_plays_a_drive_with_progress(lab, tmp_path: Path):
    program = RUST / "target" / "debug" / "duralab-bare-zenoh"
    sources = [*RUST.glob("*.toml"), *RUST.glob("*.rs"), *(RUST / "src").iterdir()]
    if shutil.which("cargo") is None:
        pytest.skip("there is no Rust on this machine")
    if not program.is_file() or program.stat().st_mtime < max(source.stat().st_mtime for source in sources):
        pytest.skip("the Rust client is not built; `make examples-rust` builds it and runs this test")
    played = subprocess.run(
        [program, lab.endpoints[0]], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert played.returncode == 0, played.stderr
    assert re.search(r"^playing \d+ %$", played.stdout, flags=re.M)
    assert re.search(r"^left_vertical: [\d.]+ to [\d.]+ N$", played.stdout, flags=re.M)
    refused = subprocess.run(
        [program, lab.endpoints[0], "predecessor"], capture_output=True, text=True, timeout=60, check=False
    )
    # Half of its drives are speeds, which are never below 0: the rig says so, and the client passes it on.
    assert refused.returncode == 1
    assert "speed" in refused.stderr
