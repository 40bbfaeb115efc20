import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from ended_processes import alive, wait_until_gone

import duralab.processes.supervisor as supervisor_module
from duralab.errors import LabError, ServiceEndedError
from duralab.processes import ServicePlan, Supervisor
from duralab.processes.supervisor import describe_exit, last_lines
from duralab_bus import open_bus


@pytest.fixture
def bus():
    with open_bus(service="duralab") as bus:
        yield bus


def test_services_are_live_after_start_and_gone_after_stop(bus, fake_services, tmp_path):
    with Supervisor([ServicePlan("steady")], bus=bus, logs=tmp_path / "logs") as supervisor:
        supervisor.start(timeout_seconds=60)
        pids = list(supervisor.process_ids.values())
        assert ("steady", "main") in bus.live()
        assert supervisor.failure() is None
    assert wait_until_gone(pids, seconds=0.0) == []
    assert "ready" in (tmp_path / "logs" / "steady.log").read_text()


def test_services_that_are_being_ended_are_no_failure_and_gone_after_stop(bus, fake_services, tmp_path):
    with Supervisor([ServicePlan("steady")], bus=bus, logs=tmp_path) as supervisor:
        supervisor.start(timeout_seconds=60)
        pids = list(supervisor.process_ids.values())
        supervisor.begin_stop()
        supervisor.begin_stop()
        assert wait_until_gone(pids, seconds=10.0) == []
        assert supervisor.failure() is None


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(("given", "threads"), [(None, "1"), ("2", "2")])
def test_services_compute_on_one_thread_unless_told_otherwise(
    bus, fake_services, tmp_path, monkeypatch, given, threads
):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if given is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", given)
    with Supervisor([ServicePlan("steady")], bus=bus, logs=tmp_path / "logs") as supervisor:
        supervisor.start(timeout_seconds=60)
        (pid,) = (psutil.Process(pid).ppid() for pid in supervisor.process_ids.values())
        assert f"OMP_NUM_THREADS={threads}".encode() in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")


def test_service_that_ends_at_once_is_named_with_code_and_log(bus, fake_services, tmp_path):
    with Supervisor([ServicePlan("steady"), ServicePlan("dying")], bus=bus, logs=tmp_path) as supervisor:
        with pytest.raises(ServiceEndedError, match=r"dying ended by itself \(exit code 3\).*the oil is cold\.$"):
            supervisor.start(timeout_seconds=60)
        pids = list(supervisor.process_ids.values())
    assert wait_until_gone(pids, seconds=0.0) == []


def test_a_service_that_met_the_limit_of_threads_says_so_whatever_panics_followed(bus, fake_services, tmp_path):
    said = r"killed by SIGABRT\): it could not start a thread, the limit of"
    with (
        Supervisor([ServicePlan("panicking")], bus=bus, logs=tmp_path) as supervisor,
        pytest.raises(ServiceEndedError, match=said),
    ):
        supervisor.start(timeout_seconds=60)


def test_service_that_does_not_come_is_named_with_its_log(bus, fake_services, tmp_path):
    plans = [ServicePlan("silent"), ServicePlan("steady")]
    with Supervisor(plans, bus=bus, logs=tmp_path) as supervisor:
        with pytest.raises(LabError, match=r"silent") as caught:
            supervisor.start(timeout_seconds=10.0)
        assert "still warming up" in caught.value.message
        assert "steady" not in caught.value.message


def test_killed_service_is_reported_with_its_signal(bus, fake_services, tmp_path):
    with Supervisor([ServicePlan("steady")], bus=bus, logs=tmp_path) as supervisor:
        supervisor.start(timeout_seconds=60)
        os.kill(supervisor.process_ids["steady"], signal.SIGKILL)
        deadline = time.monotonic() + 60
        while (ended := supervisor.failure()) is None and time.monotonic() < deadline:
            time.sleep(0.02)
        assert ended is not None
        assert "killed by SIGKILL" in ended.message
        assert ended.service == "steady"


def test_service_that_does_not_obey_is_killed(bus, fake_services, tmp_path, monkeypatch):
    monkeypatch.setattr(supervisor_module, "END_SECONDS", 0.4)
    with Supervisor([ServicePlan("stubborn")], bus=bus, logs=tmp_path) as supervisor:
        supervisor.start(timeout_seconds=60)
        pid = supervisor.process_ids["stubborn"]
    assert not alive(pid)


SCRIPT = """
import sys, time
from pathlib import Path
from duralab_bus import open_bus
from duralab.processes import ServicePlan, Supervisor
with open_bus(service="duralab") as bus, Supervisor(
    [ServicePlan("steady"), ServicePlan("identifier")], bus=bus, logs=Path(sys.argv[1])
) as supervisor:
    supervisor.start(timeout_seconds=60)
    print(*supervisor.process_ids.values(), flush=True)
    time.sleep(600)
"""


def test_no_service_outlives_a_supervisor_that_is_killed(fake_services, tmp_path):
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    pids = [int(pid) for pid in process.stdout.readline().split()]
    assert len(pids) == 2
    process.kill()
    process.wait()
    process.stdout.close()
    assert wait_until_gone(pids) == []


@pytest.mark.skipif(sys.platform != "linux", reason="services are forked on Linux only")
def test_services_outlive_the_process_that_forked_them_and_are_ended(bus, fake_services, tmp_path):
    with Supervisor([ServicePlan("steady"), ServicePlan("silent")], bus=bus, logs=tmp_path) as supervisor:
        with pytest.raises(LabError):  # the silent one never comes
            supervisor.start(timeout_seconds=5.0)
        pids = supervisor.process_ids
        (server,) = {psutil.Process(pid).ppid() for pid in pids.values()}
        assert server != os.getpid()
        os.kill(server, signal.SIGKILL)
        assert wait_until_gone([server]) == []
        assert supervisor.failure() is None
        os.kill(pids["silent"], signal.SIGKILL)
        wait_until_gone([pids["silent"]])
        assert "exit code unknown" in supervisor.failure().message
        assert alive(pids["steady"])
    assert wait_until_gone(pids.values(), seconds=0.0) == []


@pytest.mark.skipif(sys.platform != "linux", reason="services are forked on Linux only")
def test_a_service_started_again_keeps_its_own_log_folder_and_arguments(bus, fake_services, tmp_path, monkeypatch):
    for count in range(3):
        (tmp_path / str(count)).mkdir()
        monkeypatch.chdir(tmp_path / str(count))
        with Supervisor([ServicePlan("steady")], bus=bus, logs=tmp_path / str(count) / "logs") as supervisor:
            supervisor.start(timeout_seconds=60)
            log = tmp_path / str(count) / "logs" / "steady.log"
            # The bus may still know the one before.
            while "ready" not in log.read_text() and supervisor.failure() is None:
                time.sleep(0.02)
            assert psutil.Process(supervisor.process_ids["steady"]).cwd() == str(tmp_path / str(count))
        assert log.read_text().count("ready") == 1


def test_viewer_guard_takes_its_program_with_it():
    program = [sys.executable, "-c", "import os, time; print(os.getpid(), flush=True); time.sleep(600)"]
    guard = subprocess.Popen(
        [sys.executable, "-m", "duralab.processes.viewer_guard", *program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    pid = int(guard.stdout.readline())
    guard.stdin.close()
    guard.wait(60)
    guard.stdout.close()
    assert wait_until_gone([pid]) == []


def test_exit_is_described_by_code_or_signal():
    assert describe_exit(3) == "exit code 3"
    assert describe_exit(-11) == "killed by SIGSEGV"


def test_log_lines_are_shown_as_their_event(tmp_path):
    log = tmp_path / "x.log"
    log.write_text('{"event": "started"}\n{"event": "gave up", "error": "no oil"}\nTraceback line\n')
    assert last_lines(log) == "started / gave up: no oil / Traceback line"
    assert last_lines(tmp_path / "missing.log") == "none"
