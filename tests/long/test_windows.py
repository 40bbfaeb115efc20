"""Bus, gateway, SDK and command line where Windows' gaps are: no fcntl, no POSIX signals, no fork, no Drake."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from duralab.testing import FileController, LinearRig
from duralab_bus import BusConfig, open_bus
from duralab_drive_files import read_controller_map
from duralab_gateway import Approach, serving
from duralab_proto.arrays import from_array, to_record
from duralab_proto.v1 import rig_pb2

PROCESS = Path(__file__).with_name("windows_process.py")
SECONDS = 60

GATEWAY = """
from duralab.testing import LinearRig
from duralab_gateway import Approach, serve

serve(LinearRig(noise_rms=2.0), approach=Approach(ramp=0.05))
"""

IMPORTS = """
import importlib, pkgutil, sys

names = ["duralab", "duralab_bus", "duralab_drive_files", "duralab_drive_map", "duralab_gateway", "duralab_loads"]
names += ["duralab_proto", "duralab_recordings", "duralab_roads", "duralab_settings", "duralab_spectra", "file_rig"]
for name in names:
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, f"{name}."):
        if not module.name.endswith("__main__") and "foreign_gateway" not in module.name:
            importlib.import_module(module.name)
print(sum(name.startswith("duralab") for name in sys.modules), sys.platform)
"""

SPOOLS = """
import sys
from pathlib import Path

from duralab_bus import BusConfig, SpoolFolder, open_bus
from duralab_proto.v1 import rig_pb2
from duralab_settings import lock_file

folder, count = Path(sys.argv[1]), int(sys.argv[2])
spools = SpoolFolder(folder)
with open_bus(BusConfig(), service="rig_sim") as bus:
    left = bus.serve_left_spools(spools)
    publisher = bus.publisher(bus.keys.rig_state("beam"), spools=spools, durable=True)
    for number in range(count):
        publisher.put(rig_pb2.RigState(rig="beam", reason=f"{number} " + "x" * 100_000))
    try:
        lock_file(spools.path / "lock")
    except OSError:
        print(left, len(list(spools.path.glob("*.spool"))), "locked", flush=True)
    if count:
        import os

        os._exit(0)
"""


OUTBOX = """
import sys
from pathlib import Path

from duralab_drive_files import Outbox, read_controller_map

Outbox(read_controller_map(Path(sys.argv[1])))
"""

IDENTITY = """
import sys

from duralab_bus import TlsConfig, check_identity

print(check_identity(TlsConfig.of(sys.argv[1])))
"""


def run(target: str | Path, *arguments: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(PROCESS), str(target), *map(str, arguments)],
        cwd=folder,
        env={**os.environ, "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )


def script(folder: Path, text: str) -> Path:
    path = folder / "script.py"
    path.write_text(text)
    return path


@pytest.fixture
def endpoint() -> str:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def gateway(
    folder: Path, endpoint: str, *, target: str | Path = "", **settings: object
) -> Iterator[subprocess.Popen[bytes]]:
    config = folder / "gateway.yaml"
    config.write_text(json.dumps({"bus": {"listen": [endpoint]}, "exit_with_parent": True, **settings}))
    command = [sys.executable, str(PROCESS), str(target or script(folder, GATEWAY)), "--config", str(config)]
    with (
        (folder / "gateway.log").open("wb") as log,
        subprocess.Popen(command, cwd=folder, stdin=subprocess.PIPE, stdout=log, stderr=log) as process,
    ):
        try:
            yield process
        finally:
            process.kill()


def played(bus, drive: np.ndarray) -> np.ndarray:
    bus.wait_for_live({("rig_sim", "linear")}, SECONDS)
    keys = bus.keys
    description = bus.query(keys.rig_description("linear"), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    request = rig_pb2.PlayRequest(
        run="one", drive=to_record(description.drives, description.sample_rate, drive), seed=3
    )
    return from_array(bus.query(keys.rig_play("linear"), request, rig_pb2.PlayResult).response.samples)


def test_every_module_of_the_sdk_and_the_libraries_can_be_imported(tmp_path):
    done = run(script(tmp_path, IMPORTS), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    modules, platform = done.stdout.split()
    assert int(modules) > 150
    assert platform == "win32"


def test_what_is_hidden_is_really_missing(tmp_path):
    for text in ("import fcntl", "import os; os.fork", "from signal import SIGHUP", "import pydrake"):
        done = run(script(tmp_path, text), folder=tmp_path)
        assert "Error: " in done.stderr, text
        assert done.stderr.rstrip().endswith(("on Windows", "'SIGHUP' from 'signal' (unknown location)")), text


def test_spools_are_locked_and_taken_over(tmp_path):
    path, spools = script(tmp_path, SPOOLS), tmp_path / "spools"
    killed = run(path, spools, "100", folder=tmp_path)
    assert killed.stdout.split()[0::2] == ["0", "locked"], killed.stderr
    assert int(killed.stdout.split()[1]) >= 2
    after = run(path, spools, "0", folder=tmp_path)
    assert after.returncode == 0, after.stderr
    assert after.stdout.split()[0] == "1"
    # What the second one began is gone, with its lock; what the first one left waits for a recorder.
    (left,) = spools.iterdir()
    assert len(list(left.glob("*.spool"))) >= 2


def test_a_gateway_serves_its_rig_as_it_does_on_linux(tmp_path, endpoint):
    drive = 0.001 * np.sin(np.linspace(0.0, 60.0, 2000)) * np.hanning(2000) * np.ones((2, 1))
    with gateway(tmp_path, endpoint) as process:
        with open_bus(BusConfig(connect=(endpoint,), connect_timeout_seconds=SECONDS), service="test") as bus:
            there = played(bus, drive)
        process.stdin.close()
        assert process.wait(SECONDS) == 0, (tmp_path / "gateway.log").read_text()
    with (
        open_bus(BusConfig(), service="rig_sim") as served,
        serving(served, LinearRig(noise_rms=2.0), approach=Approach(ramp=0.05)),
        open_bus(BusConfig(connect=served.listening), service="test") as bus,
    ):
        np.testing.assert_array_equal(there, played(bus, drive))


CONTROLLER_MAP = """
rig: linear
sample_rate: 1000
controller_rate: 1024
lead: 0.5
drives:
  push: {channel: Push, kind: displacement, unit: mm, minimum: -10, maximum: 10, recorded_command: Push Cmd}
responses:
  load: {channel: Load, kind: force, unit: kN, minimum: -100, maximum: 100}
"""


def test_file_rig_exchanges_files_as_it_does_on_linux(tmp_path, endpoint):
    path = tmp_path / "controller.yaml"
    path.write_text(CONTROLLER_MAP)
    settings = {"maps": [str(path)], "spool_folder": str(tmp_path / "spool")}
    drive = 0.001 * np.sin(np.linspace(0.0, 60.0, 2000)) * np.hanning(2000) * np.ones((1, 1))
    controller = FileController(read_controller_map(path), lambda played: 1.0e7 * played)
    thread = threading.Thread(target=controller.run)
    with gateway(tmp_path, endpoint, target="file_rig", **settings) as process:
        thread.start()
        try:
            with open_bus(BusConfig(connect=(endpoint,), connect_timeout_seconds=SECONDS), service="test") as bus:
                load = played(bus, drive)
        finally:
            controller.end()
            thread.join()
        second = run(script(tmp_path, OUTBOX), path, folder=tmp_path)
        assert "another gateway uses this exchange folder" in second.stderr
        process.stdin.close()
        assert process.wait(SECONDS) == 0, (tmp_path / "gateway.log").read_text()
    np.testing.assert_allclose(load, 1.0e7 * 1.005 * drive, atol=20.0)
    assert controller.played_runs == ["one"]
    done = tmp_path / "exchange" / "outbox" / "done"
    assert sorted(file.suffix for file in done.iterdir()) == [".drv", ".html", ".json", ".rsp"]


def test_the_command_line_reaches_it(tmp_path, endpoint):
    assert "A durability test lab" in run("duralab", "--help", folder=tmp_path).stdout
    with gateway(tmp_path, endpoint) as process:
        with open_bus(BusConfig(connect=(endpoint,), connect_timeout_seconds=SECONDS), service="test") as bus:
            bus.wait_for_live({("rig_sim", "linear")}, SECONDS)
        status = run("duralab", "status", "--connect", endpoint, "--json", folder=tmp_path)
        (lab,) = json.loads(status.stdout)["labs"]
        assert [service["instance"] for service in lab["services"]] == ["linear"]
        assert "it is idle now" in run("duralab", "reset", "linear", "--connect", endpoint, folder=tmp_path).stdout
        checked = run("duralab", "check-rig", "linear", "--connect", endpoint, folder=tmp_path)
        assert checked.returncode == 0, checked.stdout
        process.send_signal(signal.SIGINT)
        assert process.wait(SECONDS) == 0


def test_certificates_are_made_and_shown_to_a_secured_lab(tmp_path):
    (tmp_path / "members.yaml").write_text(
        "members: [{role: router, name: main}, {role: rig, name: beam, rigs: [beam]}]"
    )
    for command in ("init", "issue", "show", "router"):
        done = run("duralab", "certs", command, folder=tmp_path)
        assert done.returncode == 0, done.stderr
    shown = run(script(tmp_path, IDENTITY), tmp_path / "certificates" / "rig.beam", folder=tmp_path)
    assert "rigs=('beam',)" in shown.stdout, shown.stderr
