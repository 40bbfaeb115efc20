"""A hub in this process, and services in processes of their own that connect to it."""

import itertools
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

import duralab_bus

HERE = Path(__file__).parent
WAIT = 120.0
"""Longest wait of a test for another process, in seconds; none of them takes so long unless it is broken."""


class Processes:
    """Starts services and ends them all."""

    def __init__(self, folder):
        self._folder = folder
        self._numbers = itertools.count()
        self.running = []

    def start(self, config, **options):
        file = self._folder / f"config{next(self._numbers)}.yaml"
        file.write_text(config if isinstance(config, str) else yaml.safe_dump(config))
        return self.run("rig_process.py", "--config", str(file), **options)

    def run(self, script, *arguments, **options):
        process = subprocess.Popen([sys.executable, str(HERE / script), *arguments], **options)
        self.running.append(process)
        return process

    def end(self):
        for process in self.running:
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout, process.stderr):
                if stream is not None:
                    stream.close()


@pytest.fixture(scope="session")
def until():
    """Wait for a condition that comes true unless something is broken."""

    def wait(condition):
        deadline = time.monotonic() + WAIT
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.01)

    return wait


@pytest.fixture
def processes(tmp_path):
    processes = Processes(tmp_path)
    yield processes
    processes.end()


@pytest.fixture
def hub():
    with duralab_bus.open_bus(service="hub") as bus:
        yield bus


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A bus with the rig `bench` on it, shared by the tests of a module that leave it as it is."""
    processes = Processes(tmp_path_factory.mktemp("lab"))
    with duralab_bus.open_bus(service="hub") as bus:
        processes.start({"bus": {"connect": list(bus.listening)}})
        bus.wait_for_live({("rig_sim", "bench")}, WAIT)
        yield bus
    processes.end()


@pytest.fixture
def bench(hub, processes):
    """A rig of this test's own: its process, live on the hub."""
    process = processes.start({"bus": {"connect": list(hub.listening)}, "workers": 1})
    hub.wait_for_live({("rig_sim", "bench")}, WAIT)
    return process
