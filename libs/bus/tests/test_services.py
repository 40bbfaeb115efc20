"""Services as processes: they say what is wrong, log as JSON, and end in time whatever is stuck."""

import ctypes
import json
import os
import signal
import socket
import subprocess
import threading
import time
from pathlib import Path

import pytest

import duralab_bus
from duralab_proto.v1 import rig_pb2

WAIT = 120.0


def ended(process, seconds=WAIT):
    """Return the exit code and standard error of a process that ends by itself."""
    _, error = process.communicate(timeout=seconds)
    return process.returncode, error


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ("colour: red", ["unknown key 'colour'; allowed: bus, exit_with_parent, metrics, workers, trace_folder, rigs"]),
        ("bus: {listen: [nonsense]}", ["bus.listen.0", "'nonsense'", "tcp/<host>:<port>"]),
        ("workers: none", ["workers is 'none'"]),
        ("workers: 0\nbus: 3", ["workers is 0", "bus is 3"]),
        ("- a\n- b", ["holds a list"]),
        ("a: [", ["is not YAML"]),
    ],
)
def test_bad_configuration_is_one_sentence_and_exit_code_two(processes, config, said):
    code, error = ended(processes.start(config, stderr=subprocess.PIPE, text=True))
    assert code == 2
    assert error.count("\n") == 1
    for part in said:
        assert part in error


def test_missing_configuration_file_is_named(processes):
    process = processes.run("rig_process.py", "--config", "no-such-file.yaml", stderr=subprocess.PIPE, text=True)
    code, error = ended(process)
    assert (code, error) == (
        2,
        "Cannot read the configuration no-such-file.yaml: No such file or directory; correct its path or its rights.\n",
    )


def test_port_in_use_is_one_sentence_and_exit_code_two(processes):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        code, error = ended(processes.start({"bus": {"listen": [endpoint]}}, stderr=subprocess.PIPE, text=True))
    assert code == 2
    assert error.count("\n") == 1
    assert f"{endpoint} is in use" in error


def test_service_ends_on_signal_in_order_and_logs_json(hub, processes):
    process = processes.start({"bus": {"connect": list(hub.listening)}}, stderr=subprocess.PIPE, text=True)
    hub.wait_for_live({("rig_sim", "bench")}, WAIT)
    with pytest.raises(duralab_bus.FaultError):
        hub.query(hub.keys.rig_play("bench"), rig_pb2.PlayRequest(run="defect.1"), rig_pb2.PlayResult)
    process.send_signal(signal.SIGINT)
    code, error = ended(process, 3.0)
    assert code == 0
    lines = [json.loads(line) for line in error.splitlines()]
    assert [line["event"] for line in lines] == [
        "ready",
        "A query failed by a defect of this service.",
        "ending",
        "taken apart",
        "ended",
    ]
    assert all(line["service"] == "rig_sim" and line["timestamp"].endswith("Z") and line["level"] for line in lines)
    assert "ZeroDivisionError" in lines[1]["exception"]
    assert lines[1]["key"] == hub.keys.rig_play("bench")
    assert lines[2]["why"] == "SIGINT"


def test_a_service_that_seems_to_stand_still_is_asked_where_its_threads_are(hub, processes):
    process = processes.start({"bus": {"connect": list(hub.listening)}}, stderr=subprocess.PIPE, text=True)
    hub.wait_for_live({("rig_sim", "bench")}, WAIT)
    process.send_signal(signal.SIGUSR1)
    lines = iter(process.stderr.readline, "")
    told = next(json.loads(line) for line in lines if "asked where" in line)
    process.terminate()
    code, error = ended(process, 3.5)
    assert code == 0
    assert '"ended"' in error
    (main,) = (calls for thread, calls in told["threads"].items() if thread.startswith("MainThread"))
    assert any(call.endswith(" run_service") for call in main)
    assert any(thread.startswith("duralab_bus-keep-alive") for thread in told["threads"])


def test_a_signal_that_comes_to_another_thread_ends_the_service_in_order(hub, processes):
    process = processes.start({"bus": {"connect": list(hub.listening)}}, stderr=subprocess.PIPE, text=True)
    hub.wait_for_live({("rig_sim", "bench")}, WAIT)
    threads = sorted(int(thread.name) for thread in Path(f"/proc/{process.pid}/task").iterdir())
    assert threads[0] == process.pid
    assert ctypes.CDLL(None).tgkill(process.pid, threads[-1], signal.SIGTERM) == 0
    code, error = ended(process, 3.5)
    assert code == 0
    assert [json.loads(line)["event"] for line in error.splitlines()][-1] == "ended"
    assert '"why": "SIGTERM"' in error


def test_handlers_end_before_what_they_use_is_taken_apart(hub, processes):
    process = processes.start({"bus": {"connect": list(hub.listening)}}, stderr=subprocess.PIPE, text=True)
    hub.wait_for_live({("rig_sim", "bench")}, WAIT)
    request = rig_pb2.PlayRequest(run="wait.1")
    result = hub.query(
        hub.keys.rig_play("bench"), request, rig_pb2.PlayResult, on_progress=lambda _progress: process.terminate()
    )
    assert result.run == "wait.1"
    code, error = ended(process, 3.5)
    assert code == 0
    lines = [json.loads(line) for line in error.splitlines()]
    assert [line["event"] for line in lines] == ["ready", "ending", "handler ended", "taken apart", "ended"]
    assert lines[2]["run"] == "wait.1"


def test_stuck_handler_does_not_keep_the_service_from_ending(hub, processes):
    process = processes.start({"bus": {"connect": list(hub.listening)}}, stderr=subprocess.DEVNULL)
    hub.wait_for_live({("rig_sim", "bench")}, WAIT)
    began, faults = threading.Event(), []

    def ask():
        request = rig_pb2.PlayRequest(run="stuck.1")
        try:
            hub.query(
                hub.keys.rig_play("bench"), request, rig_pb2.PlayResult, on_progress=lambda _progress: began.set()
            )
        except duralab_bus.FaultError as fault:
            faults.append(fault)

    asking = threading.Thread(target=ask)
    asking.start()
    assert began.wait(WAIT)
    process.terminate()
    process.wait(WAIT)
    asking.join(WAIT)
    assert [fault.code_name for fault in faults] == ["UNAVAILABLE"]


def test_service_ends_when_the_other_end_of_its_input_closes(hub, processes):
    process = processes.start(
        {"bus": {"connect": list(hub.listening)}, "exit_with_parent": True},
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    hub.wait_for_live({("rig_sim", "bench")}, WAIT)
    # As after kill -9 of the supervisor: both pipes lose their other end at once.
    process.stderr.close()
    process.stdin.close()
    assert process.wait(WAIT) == 0


def test_service_told_to_end_while_it_is_set_up_ends(processes):
    with socket.socket() as silent:
        # Accepts and says nothing: the session waits for it.
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        endpoint = f"tcp/127.0.0.1:{silent.getsockname()[1]}"
        process = processes.start(
            {"bus": {"connect": [endpoint], "connect_timeout_seconds": 60}, "exit_with_parent": True},
            stdin=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        silent.settimeout(WAIT)
        connection, _ = silent.accept()
        with connection:
            began = time.monotonic()
            process.stdin.close()
            process.wait(WAIT)
            # Not the 60 s for which it may try to connect.
            assert time.monotonic() - began < 30.0


def test_service_is_gone_from_the_bus_when_it_has_ended(hub, bench):
    bench.terminate()
    assert bench.wait(WAIT) == 0
    with pytest.raises(ProcessLookupError):
        os.kill(bench.pid, 0)
    with pytest.raises(duralab_bus.FaultError) as caught:
        hub.query(hub.keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState)
    assert caught.value.code_name == "UNAVAILABLE"
