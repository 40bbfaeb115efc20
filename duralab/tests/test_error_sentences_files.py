"""Error sentences of recordings, reports, sweeps and processes that no command provokes by a mistake in its files."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import synthetic_campaign
import synthetic_endurance

import duralab
from duralab.errors import InputError, LabError
from duralab.processes import (
    OperatorPage,
    ServicePlan,
    Supervisor,
    Viewer,
    end_lab,
    findings_of,
    page,
    service_process,
    viewer,
)
from duralab.processes.lab_notes import RunningLab
from duralab.processes.supervisor import last_lines, require_services
from duralab.processes.viewer import require_free_port, viewer_program
from duralab.recording import EnduranceRecording
from duralab.recording.judged_windows import JudgedWindows
from duralab.report import write_pdf
from duralab.sweeps import load_sweep
from duralab.sweeps.campaign_task import open_cell, prepare_worker
from duralab.sweeps.cluster import PointRunner, open_workers
from duralab.sweeps.results import OUTCOME, read_outcome
from duralab.sweeps.specimens import Specimens
from duralab.sweeps.sweep_file import CellKind
from duralab_bus import BusError

SHIPPED_SWEEP = "fifty_gains_and_seeds"
SCHEDULER = "tcp://127.0.0.1:1"


def fail(error):
    """Return a function that raises an error, whatever it is called with."""

    def failing(*_, **__):
        raise error

    return failing


@pytest.mark.parametrize(
    ("schedule", "sentence"),
    [
        ("name: [weeks\n", r"The schedule in .*weeks\.mcap is not YAML: .*line 2"),
        ("name: weeks\nrig: front_axle\nevents: {}\n", r"The schedule in .*weeks\.mcap: events"),
    ],
)
def test_a_schedule_in_a_recording_that_cannot_be_read_is_told(tmp_path, schedule, sentence):
    endurance = synthetic_endurance.make(volume_repeats=200)
    endurance.volumes[0][0].schedule = schedule
    recording = EnduranceRecording(synthetic_endurance.write(tmp_path, endurance))
    with pytest.raises(InputError, match=sentence):
        _ = recording.schedule


def test_a_run_with_other_channels_than_its_rig_is_told(tmp_path):
    steps = synthetic_campaign.steps(synthetic_campaign.make(seconds=2.0, iterations=1))
    steps += synthetic_campaign.signal_blocks(np.zeros((2, 200)), np.zeros((3, 200)), run="other")
    recording = duralab.open(synthetic_campaign.write(tmp_path / "r.mcap", steps))
    with pytest.raises(InputError, match=r"the run 'other' with 2 drives and 3 responses; its rig has 6 and 6\.$"):
        recording.signal("other")


def test_a_recording_without_name_or_runs_is_told(tmp_path):
    with pytest.raises(InputError, match=r"^There is no recording ''; give the path of an \.mcap file\.$"):
        duralab.open("")
    steps = synthetic_campaign.steps(synthetic_campaign.make(seconds=2.0, iterations=1))[:3]
    recording = duralab.open(synthetic_campaign.write(tmp_path / "r.mcap", steps))
    with pytest.raises(InputError, match=r"No run is asked for and none is recorded; give the name of a run"):
        recording.responses()


def test_a_judged_run_whose_file_was_changed_since_is_told(recording_path):
    changed = SimpleNamespace(path=recording_path, messages=lambda _: iter(()))
    windows = JudgedWindows(
        changed, targets=[np.zeros((6, 4))], sample_rate=1.0, levels={"demo.i01": 1.0}, errors=False
    )
    with pytest.raises(InputError, match=r"holds no in-band response of the run 'demo\.i01' any more\.$"):
        windows.read("demo.i01", 0, 2)


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (
            subprocess.TimeoutExpired("chromium", 300.0),
            r"The browser chromium did not print within 300 s; try again\.$",
        ),
        (OSError(8, "Exec format error"), r"The browser chromium cannot be started: Exec format error\.$"),
    ],
)
def test_a_browser_that_does_not_print_is_told(tmp_path, monkeypatch, recording_path, error, sentence):
    monkeypatch.setattr("duralab.report.pdf.write_report", lambda *_: None)
    monkeypatch.setattr(subprocess, "run", fail(error))
    with pytest.raises(LabError, match=sentence):
        write_pdf(recording_path, tmp_path / "r.pdf", browser="chromium")


@pytest.mark.parametrize(
    ("threads", "versions", "sentence"),
    [
        (None, {}, rf"No scheduler with workers answers at {SCHEDULER}; start `dask scheduler`"),
        (2, {}, r"The worker w runs several tasks at once; .* `dask worker --nthreads 1`\.$"),
        (1, {"duralab": "0"}, r"The worker w has duralab 0 \(here .*\); install the same everywhere\.$"),
    ],
)
def test_workers_that_cannot_run_a_sweep_are_refused(tmp_path, monkeypatch, threads, versions, sentence):
    class Client:
        def __init__(self, *_, **__):
            if threads is None:
                raise OSError("Timed out")

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def wait_for_workers(self, *_, **__):
            pass

        def nthreads(self):
            return {"w": threads}

        def run(self, called):
            return {"w": called() | versions}

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=Client))
    with pytest.raises(LabError, match=sentence), open_workers(tmp_path, workers=None, scheduler=SCHEDULER):
        pass


def test_a_sweep_without_dask_names_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match=r"A sweep needs Dask .*; install duralab\[sweeps\]\.$"),
        open_workers(tmp_path, workers=1, scheduler=None),
    ):
        pass


def test_what_a_sweep_cannot_use_is_told(tmp_path, monkeypatch):
    (tmp_path / "text").write_text("")
    with pytest.raises(LabError, match=r"The worker \S+ cannot write in .*text: .*; give a folder \(--out\)"):
        prepare_worker(tmp_path / "text")
    (tmp_path / OUTCOME).write_text("a text")
    with pytest.raises(InputError, match=r"outcome\.parquet is not the outcome of a point \(.*\); remove it"):
        read_outcome(tmp_path)
    runner = PointRunner(lambda: None, load_sweep(SHIPPED_SWEEP), folder=tmp_path, retry_failed=False)
    with pytest.raises(LabError, match=r"The scheduler abandoned the campaigns; .* run the sweep again to continue"):
        runner._outcome(None, SimpleNamespace(cancelled=lambda: True))
    monkeypatch.setattr("duralab.sweeps.campaign_task.open_bus", fail(BusError("The bus is closed.")))
    cell = open_cell(CellKind.LAB, rigs=("front_axle",), specimens=(), folder=tmp_path / "cell")
    with pytest.raises(LabError, match=r"^The bus is closed\.$"), cell:
        pass
    monkeypatch.setattr(subprocess, "run", fail(OSError("no simulator")))
    with pytest.raises(LabError, match=r"does not report which specimens it ships: no simulator\.$"):
        Specimens(load_sweep(SHIPPED_SWEEP)).document("front_axle")


def operator_page(folder, *, endpoint="tcp/127.0.0.1:1"):
    return OperatorPage(endpoint, folder=folder / "page", log=folder / "page.log")


def test_an_operator_page_that_ends_at_once_is_told_with_its_last_line(tmp_path):
    with pytest.raises(InputError, match=r"^The operator page ended at once \(exit code 2\): .*[^.]; correct that, or"):
        operator_page(tmp_path, endpoint="nowhere")


def test_a_line_that_a_log_repeats_is_told_once(tmp_path):
    (tmp_path / "log").write_text("ready\nno oil\nno oil\nno oil\n")
    assert last_lines(tmp_path / "log") == "ready / no oil"


def test_an_operator_page_that_does_not_start_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(page, "START_SECONDS", 0.0)
    with pytest.raises(LabError, match=r"The page did not start within 0 s: "):
        operator_page(tmp_path)
    monkeypatch.setattr(subprocess, "Popen", fail(OSError(12, "Cannot allocate memory")))
    with pytest.raises(LabError, match=r"The operator page could not be started: Cannot allocate memory\.$"):
        operator_page(tmp_path)


def test_what_a_viewer_cannot_use_is_told(tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"There is no file '.*live\.rrd'; give the path of a live\.rrd"):
        Viewer(file=tmp_path / "live.rrd")
    with socket.create_server(("127.0.0.1", 0)) as used:
        port = used.getsockname()[1]
        with pytest.raises(InputError, match=rf"The port {port} of 127\.0\.0\.1 is in use; .* another with --port\.$"):
            require_free_port(port, option="--port")
    monkeypatch.setattr(viewer.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"The Rerun viewer is not installed here; .* or leave --view out\.$"):
        viewer_program()


@pytest.mark.parametrize(
    ("program", "seconds", "sentence"),
    [("false", 20.0, r"The viewer ended at once \("), ("cat", 0.0, r"The viewer did not start within 0 s: ")],
)
def test_a_viewer_that_does_not_start_is_told(monkeypatch, program, seconds, sentence):
    monkeypatch.setattr(viewer, "START_SECONDS", seconds)
    monkeypatch.setattr(viewer, "viewer_program", lambda: Path(f"/bin/{program}"))
    with pytest.raises(LabError, match=sentence):
        Viewer(port=0, native=True)


def test_services_that_cannot_be_used_are_told(tmp_path, monkeypatch):
    with pytest.raises(LabError, match=r"has no no_service, .*; install the services with pip install .*--connect\.$"):
        require_services("no_service")
    failed = subprocess.CompletedProcess([], 1, stdout="", stderr="Traceback\nMemoryError.\n")
    (tmp_path / "r.mcap").write_bytes(b"\x89MCAP")
    with monkeypatch.context() as patch:
        patch.setattr(subprocess, "run", lambda *_, **__: failed)
        with pytest.raises(LabError, match=r"The recording .*r\.mcap could not be verified: MemoryError\.$"):
            findings_of(tmp_path / "r.mcap")
    bus = SimpleNamespace(config=SimpleNamespace(lab="local"), listening=("tcp/127.0.0.1:1",))
    monkeypatch.setattr("duralab.processes.supervisor.start_service", fail(OSError(12, "Cannot allocate memory")))
    with (
        Supervisor([ServicePlan("iterator")], bus=bus, logs=tmp_path / "logs") as supervisor,
        pytest.raises(LabError, match=r"service iterator could not be started: Cannot allocate memory; free memory\.$"),
    ):
        supervisor.start()


def test_a_lab_of_another_user_is_not_ended(monkeypatch):
    process = psutil.Process()
    lab = RunningLab("tcp/127.0.0.1:1", process.pid, process.create_time(), "here", "recordings", {})
    monkeypatch.setattr(psutil.Process, "terminate", fail(psutil.AccessDenied(process.pid)))
    with pytest.raises(LabError, match=rf"\(process {process.pid}\) belongs to another user, who has to end it\.$"):
        end_lab(lab)


def test_a_process_that_forks_no_service_in_time_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(service_process, "_START_SECONDS", 0.1)
    server = service_process._ForkServer(dict(os.environ))
    os.kill(server._process.pid, signal.SIGSTOP)
    try:
        with pytest.raises(LabError, match=r"^No service was forked in 0\.1 s; free processor time and start again\.$"):
            server.start("recorder", config=tmp_path / "recorder.yaml", log=tmp_path / "log")
    finally:
        server._process.kill()
        server._process.wait()
