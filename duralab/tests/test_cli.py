"""The command line as a user meets it: exit codes, one sentence for an error, nothing left behind."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
import synthetic_campaign
import yaml
from ended_processes import alive, wait_until_gone
from test_campaign_file import changed
from typer.testing import CliRunner

from duralab import Channel, Signals, cli, processes
from duralab.cli.application import app
from duralab.cli.run_display import remaining_words, shown_playbacks
from duralab.formats import write_signals
from duralab.processes import running_labs
from duralab.recording import open_recording

ZEROS = np.zeros((6, 100))
COMMAND = [sys.executable, "-m", "duralab"]


def invoke(*arguments):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.stdout, result.stderr


def quick(tmp_path, path="target.road.duration", value=4.0):
    content = yaml.safe_load(changed(path, value))
    content["target"].get("road", {})["duration"] = 4.0
    content["stop"]["iterations"] = 2
    if path != "accept":
        # What the fake lab reproduces in two playbacks.
        content["accept"] = {"relative_rms_error": 1.0, "peak_ratio": [0.5, 2.0], "damage_ratio": None}
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


def services_of(parent):
    """Return the process ids of the services that a command started, in the order of their start."""
    family = psutil.Process(parent).children(recursive=True)
    return [child.pid for child in family if "duralab.processes.fork_server" not in child.cmdline()]


def start_up(tmp_path, *options):
    """Start `duralab up` on a free port; return its process, its endpoint and the services' process ids."""
    process = subprocess.Popen(
        [*COMMAND, "up", "--listen", "tcp/127.0.0.1:0", "--recordings", str(tmp_path / "rec"), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    line = process.stdout.readline()
    assert "The lab is up" in line, process.communicate()
    endpoint = re.search(r"tcp/127\.0\.0\.1:\d+", line)[0]
    return process, endpoint, [int(pid) for pid in re.findall(r"\((\d+)\)", line)]


def finish(process, *, seconds=120):
    try:
        stdout, stderr = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        # A process that hangs is this test's failure, and must not become the next one's.
        process.kill()
        pytest.fail(f"did not end within {seconds} s; it said {process.communicate()}")
    return process.returncode, stdout, stderr


@pytest.fixture(scope="module")
def running_lab(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        here = Path(__file__).parent
        patch.setenv("PYTHONPATH", f"{here / 'fakes'}{os.pathsep}{here}")
        lab = start_up(tmp_path_factory.mktemp("up"))
    yield lab
    if lab[0].poll() is None:
        lab[0].terminate()
        finish(lab[0])


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["run", "nowhere.yaml"], "There is no campaign file 'nowhere.yaml'"),
        (["report", "nowhere.mcap"], "There is no recording 'nowhere.mcap'"),
        (["view", "nowhere.rrd"], "There is no file 'nowhere.rrd'"),
        (["rigs", "--connect", "nowhere"], "'nowhere' is not of the form 'tcp/<host>:<port>'"),
        (["up", "--listen", "nowhere"], "'nowhere' is not of the form 'tcp/<host>:<port>'"),
        (["run", "front_axle_demo", "--connect", "tcp/127.0.0.1:1", "--view"], "--view is an option of the lab"),
        (["run", "front_axle_demo", "--connect", "tcp/127.0.0.1:1", "--profile"], "--profile belongs to a private lab"),
    ],
)
def test_wrong_argument_is_one_sentence_and_exit_code_2(arguments, part, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, stdout, stderr = invoke(*arguments)
    assert code == 2
    assert part in stderr
    assert stderr.startswith("Error: ")
    assert stderr.count("\n") == 1
    assert "Traceback" not in stdout + stderr
    assert not any(path.suffix in {".html", ".mcap", ".rrd"} for path in tmp_path.rglob("*"))


def test_unknown_option_and_command_are_usage_errors():
    assert invoke("run", "x", "--fast")[0] == 2
    assert invoke("fly")[0] == 2


def test_help_names_the_exit_codes():
    code, stdout, _ = invoke("--help")
    assert code == 0
    assert "130 interrupted" in " ".join(stdout.split())
    assert invoke()[1] == stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_that_cannot_be_written_is_one_sentence(option):
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "duralab", option]
        ended = subprocess.run(command, check=False, stdout=full, stderr=subprocess.PIPE, text=True, timeout=120)
    assert ended.returncode == 1
    assert (
        ended.stderr
        == "Error: The output cannot be written: No space left on device; free space, or send it elsewhere.\n"
    )


def test_wrong_campaign_is_refused_before_anything_starts(tmp_path):
    file = quick(tmp_path, "update.gian", 0.5)
    code, _, stderr = invoke("run", file, "--out", tmp_path / "out")
    assert code == 2
    assert "unknown key 'gian' in update" in stderr
    assert not (tmp_path / "out").exists()


def test_report_is_written_and_never_overwritten_unasked(recording_path, tmp_path):
    path = tmp_path / "r.html"
    code, stdout, _ = invoke("report", recording_path, "--out", path)
    assert code == 0
    assert f"open {path}" in stdout
    before = path.read_bytes()
    path.write_text("mine")
    code, _, stderr = invoke("report", recording_path, "--out", path)
    assert code == 2
    assert "would be overwritten; give --replace" in stderr
    assert path.read_text() == "mine"
    assert invoke("report", recording_path, "--out", path, "--replace")[0] == 0
    assert path.read_bytes() == before


def test_report_of_a_folder_or_a_text_is_refused(tmp_path):
    (tmp_path / "x.mcap").write_text("no recording, but long enough to be one")
    for path in (tmp_path, tmp_path / "x.mcap"):
        code, _, stderr = invoke("report", path, "--out", tmp_path / "r.html")
        assert code == 2, stderr
        assert not (tmp_path / "r.html").exists()


def test_run_leaves_its_outputs_and_prints_the_table(fake_services, tmp_path):
    out = tmp_path / "out"
    run = subprocess.run(
        [*COMMAND, "run", str(quick(tmp_path)), "--out", str(out)], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert sorted(path.name for path in out.iterdir()) == ["live.rrd", "logs", "recording.mcap", "report.html"]
    assert sorted(path.name for path in (out / "logs").iterdir()) == [
        "identifier.log",
        "iterator.log",
        "recorder.log",
        "rig_sim.log",
    ]
    figures = synthetic_campaign.make(seconds=4.0, iterations=2).errors
    for i, name in enumerate(synthetic_campaign.NAMES):
        assert re.search(rf"{name.replace('_', ' ')} +{figures[0, i]:.3f} +{figures[1, i]:.3f}", run.stdout)
    for name in ("recording.mcap", "live.rrd", "report.html"):
        assert str(out / name) in run.stdout
    again = subprocess.run(
        [*COMMAND, "run", str(quick(tmp_path)), "--out", str(out)], capture_output=True, text=True, check=False
    )
    assert again.returncode == 2
    assert "would be overwritten" in again.stderr


@pytest.mark.parametrize("how", ["--real-time", "real_time"])
def test_a_campaign_is_rehearsed_in_real_time_by_an_option_or_by_its_file(running_lab, tmp_path, how):
    file = quick(tmp_path, *(("real_time", True) if how == "real_time" else ()))
    options = [how] if how == "--real-time" else []
    code, stdout, stderr = invoke("run", file, *options, "--connect", running_lab[1], "--out", tmp_path / "out")
    assert code == 0, stderr
    assert "identifying the rig in real time" in stdout


def test_a_lab_in_real_time_plays_every_drive_so(fake_services, tmp_path):
    write_signals(Signals(tuple(Channel(n, "m") for n in synthetic_campaign.NAMES), 1000.0, ZEROS), tmp_path / "d.csv")
    process, endpoint, _ = start_up(tmp_path, "--real-time")
    # Read here: what was read ahead of the first line is not among what `communicate` returns.
    said = process.stdout.readline()
    code, stdout, stderr = invoke("play", "front_axle", tmp_path / "d.csv", "--connect", endpoint, "--json")
    process.terminate()
    finish(process)
    assert code == 0, stderr
    assert json.loads(stdout)["real_time_factor"] == 1.0
    assert "All rigs play in real time" in said


def test_faulted_campaign_is_exit_code_1_and_keeps_what_was_there(fake_services, tmp_path, monkeypatch):
    monkeypatch.setenv("FAKE_ITERATOR", "fault")
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("an older one")
    run = subprocess.run(
        [*COMMAND, "run", str(quick(tmp_path)), "--out", str(out), "--replace"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 1
    assert run.stderr == "Error: The rig is interlocked: it met a limit.\n"
    assert (out / "report.html").read_text() == "an older one"
    assert sorted(path.name for path in out.iterdir()) == ["logs", "report.html"]


def test_dying_service_ends_the_lab_with_its_name(fake_services, tmp_path):
    process, _, pids = start_up(tmp_path)
    os.kill(pids[1], signal.SIGKILL)
    code, _, stderr = finish(process)
    assert code == 1
    assert "The service identifier ended by itself (killed by SIGKILL)" in stderr
    assert wait_until_gone(pids, seconds=0.0) == []


def test_interrupt_stops_the_campaign_and_ends_the_lab(fake_services, tmp_path, monkeypatch):
    monkeypatch.setenv("FAKE_ITERATOR", "stay")
    monkeypatch.setenv("FAKE_STOPPED", str(tmp_path / "stopped"))
    process = subprocess.Popen(
        # Deaf to SIGINT from the start, as a script's shell makes what it starts with &.
        [
            "sh",
            "-c",
            'trap "" INT; exec "$@"',
            "sh",
            *COMMAND,
            "run",
            str(quick(tmp_path)),
            "--out",
            str(tmp_path / "out"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    for line in process.stdout:
        if "identifying the rig" in line:
            break
    started = services_of(process.pid)
    assert len(started) == 4
    process.send_signal(signal.SIGINT)
    code, _, stderr = finish(process)
    assert code == 130, stderr
    kept = tmp_path / "out" / "recording.mcap"
    assert stderr == (
        "Interrupted; everything that was started is ended. "
        f"What was played until then is in {kept}; `duralab.open` reads it.\n"
    )
    assert (tmp_path / "stopped").read_text() == "interrupted by the user"
    assert wait_until_gone(started, seconds=0.0) == []
    assert sorted(path.name for path in kept.parent.iterdir()) == ["live.rrd", "logs", "recording.mcap"]
    assert open_recording(kept).specification.id == "demo"


def test_remaining_time_is_said_in_minutes():
    assert remaining_words(125.0) == "2:05 left"
    assert remaining_words(-1.0) == ""


def test_many_playbacks_are_cut_to_the_first_the_best_and_the_last():
    assert shown_playbacks(7, best=6) == list(range(7))
    shown = shown_playbacks(30, best=11)
    assert len(shown) == 8
    assert {0, 11, 29} <= set(shown)


def test_viewer_is_started_on_loopback_and_ended(tmp_path, monkeypatch):
    pytest.importorskip("rerun_cli")
    from duralab.processes import Viewer, viewer_program

    with Viewer(port=0, web_port=0, native=False) as viewer:
        binary = str(viewer_program())
        pids = [
            int(folder.name)
            for folder in Path("/proc").glob("[0-9]*")
            if _command_of(folder)[:1] == [binary] and str(viewer._port) in _command_of(folder)
        ]
        assert len(pids) == 1
        ports = _listening_addresses(pids[0])
        assert ports
        assert {address for address, _ in ports} == {"127.0.0.1"}
        assert {viewer._port, viewer._web_port} <= {port for _, port in ports}
        assert viewer.page.startswith(f"http://127.0.0.1:{viewer._web_port}/?url=rerun%2Bhttp")
    assert wait_until_gone(pids) == []


def _command_of(folder):
    try:
        return (folder / "cmdline").read_bytes().decode().split("\0")
    except OSError:
        return []


def _listening_addresses(pid):
    inodes = {str(link.readlink()) for link in Path(f"/proc/{pid}/fd").iterdir() if link.is_symlink()}
    found = set()
    for family in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{family}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and f"socket:[{words[9]}]" in inodes:
                address, port = words[1].split(":")
                quad = ".".join(str(b) for b in bytes.fromhex(address)[::-1]) if family == "tcp" else address
                found.add((quad, int(port, 16)))
    return found


def test_lab_that_is_up_can_be_used_by_others(running_lab, tmp_path):
    _, endpoint, pids = running_lab
    assert len(pids) == 5
    code, stdout, _ = invoke("rigs", "--connect", endpoint)
    assert code == 0
    assert "left_longitudinal" in stdout
    assert "± 0.125 m" in stdout
    code, _, stderr = invoke("run", quick(tmp_path), "--connect", endpoint, "--out", tmp_path / "out")
    assert code == 0, stderr
    assert all(alive(pid) for pid in pids)


def test_target_not_reached_is_exit_code_3_with_outputs(running_lab, tmp_path):
    file = quick(tmp_path, "accept", {"relative_rms_error": 0.001})
    out = tmp_path / "out"
    code, stdout, _ = invoke("run", file, "--connect", running_lab[1], "--out", out)
    assert code == 3
    assert "The target was not reached" in stdout
    assert "✗" in stdout
    assert (out / "report.html").exists()
    # A small error alone is not enough.
    file = quick(tmp_path, "accept", {"relative_rms_error": 1.0, "damage_ratio": [0.999, 1.001]})
    code, stdout, _ = invoke("run", file, "--connect", running_lab[1], "--out", out, "--replace", "--json")
    told = json.loads(stdout)
    assert (code, told["judgement"]) == (3, "not reached")
    assert {found["criterion"] for found in told["not_accepted"]} >= {"damage_ratio"}
    assert "damage at k = 5 of" in told["verdict"]


def test_unknown_rig_is_refused_and_leaves_no_file(running_lab, tmp_path):
    code, _, stderr = invoke(
        "run", quick(tmp_path, "rig", "rear"), "--connect", running_lab[1], "--out", tmp_path / "o"
    )
    assert code == 2
    assert stderr == "Error: There is no rig 'rear'; there are front_axle, predecessor.\n"
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("same", ["listen", "recordings"])
def test_a_second_up_says_where_the_lab_runs_and_how_to_end_it(running_lab, tmp_path, same):
    process, endpoint, pids = running_lab
    recordings = tmp_path / "other" if same == "listen" else running_labs()[0].recordings
    listen = endpoint if same == "listen" else "tcp/127.0.0.1:0"
    code, _, stderr = invoke("up", "--listen", listen, "--recordings", recordings)
    assert code == 2
    assert stderr.startswith(f"Error: Your lab runs already at {endpoint} (process {process.pid}, recordings in /")
    assert "end it with `duralab down`, or start a second one with another --listen" in stderr
    assert stderr.count("\n") == 1
    assert all(alive(pid) for pid in pids)


def test_port_in_use_is_said_by_up(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        code, _, stderr = invoke("up", "--listen", endpoint, "--recordings", tmp_path)
    assert code == 2
    assert f"The endpoint {endpoint} is in use by another process" in stderr


def test_terminated_lab_ends_its_services(running_lab):
    process, _, pids = running_lab
    process.send_signal(signal.SIGTERM)
    code, _, stderr = finish(process)
    assert code == 143
    assert stderr == "Terminated; everything that was started is ended.\n"
    assert wait_until_gone(pids, seconds=0.0) == []


@pytest.mark.parametrize(
    ("line", "begins"),
    [
        ("run front_axle_demo", True),
        ("up --rig front_axle", True),
        ("run front_axle_demo --connect tcp/127.0.0.1:7474", False),
        ("run front_axle_demo --connect=tcp/127.0.0.1:7474", False),
        ("up --help", False),
        ("rigs", False),
        ("", False),
    ],
)
def test_the_imports_of_a_private_lab_begin_with_the_command(monkeypatch, line, begins):
    begun = []
    monkeypatch.setattr(processes, "import_ahead", lambda: begun.append(True), raising=False)
    cli._import_ahead(line.split())
    assert bool(begun) is begins


@pytest.mark.parametrize(("given", "threads"), [(None, "1"), ("2", "2")])
def test_the_command_computes_with_one_thread_unless_told_otherwise(monkeypatch, given, threads):
    found = []

    def end(_):
        found.append(os.environ["OMP_NUM_THREADS"])
        raise SystemExit

    monkeypatch.setattr(cli, "_import_ahead", end)
    monkeypatch.setenv("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # Set first, so that what the command sets is undone.
    monkeypatch.setenv("OMP_NUM_THREADS", given or "")
    if given is None:
        monkeypatch.delenv("OMP_NUM_THREADS")
    with pytest.raises(SystemExit):
        cli.main()
    assert found == [threads]
