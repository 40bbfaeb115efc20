"""A lab on the bus whose iterator is a process that is killed and started again."""

import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from duralab_bus import BusConfig, FaultError, open_bus
from duralab_proto.v1 import iterator_pb2, query_pb2

from .fake_lab import Identifier, Lab, Recorder

RIG_PROCESS = Path(__file__).with_name("rig_process.py")


class Iterator:
    """The iterator as a process that is killed and started again, forked where its imports are done already."""

    def __init__(self, bus, folder, lab):
        self._bus = bus
        self._file = folder / "iterator.yaml"
        self._file.write_text(yaml.safe_dump({"bus": {"lab": lab, "connect": list(bus.listening)}}))
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(["iterator.service"])
        self._process = None

    def start(self):
        module = {"run_name": "__main__", "alter_sys": True}
        self._process = self._context.Process(target=runpy.run_module, args=("iterator",), kwargs=module, daemon=True)
        with pytest.MonkeyPatch.context() as patch:
            # What the new process takes its own arguments from.
            patch.setattr(sys, "argv", ["iterator", "--config", str(self._file)])
            self._process.start()

    def wait(self):
        self._bus.wait_for_live({("iterator", "main")}, 120.0)

    def kill(self):
        os.kill(self._process.pid, signal.SIGKILL)

    def end(self):
        self._process.kill()
        self._process.join(10.0)
        until = time.monotonic() + 10.0
        while self._bus.live("iterator") and time.monotonic() < until:
            time.sleep(0.01)


@contextmanager
def rigs_of_their_own(bus, folder, lab, rigs):
    file = folder / "rigs.yaml"
    settings = {"bus": {"lab": lab, "connect": list(bus.listening)}, "exit_with_parent": True}
    file.write_text(yaml.safe_dump({**settings, "rigs": rigs}))
    command = [sys.executable, str(RIG_PROCESS), "--config", str(file)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as running:
        try:
            yield
        finally:
            running.kill()


@contextmanager
def killable_lab(name, folder, rigs):
    """A lab whose iterator is killed and started again; recorder and identifier are fakes of this process."""
    with open_bus(BusConfig(lab=name), service="test") as hub:
        joined = BusConfig(lab=name, connect=hub.listening)
        with open_bus(joined, service="recorder") as recorder, open_bus(joined, service="identifier") as identifier:
            iterator = Iterator(hub, folder, name)
            with rigs_of_their_own(hub, folder, name, rigs):
                try:
                    iterator.start()
                    lab = Lab(hub, Recorder(recorder), Identifier(identifier))
                    lab.iterator = iterator
                    iterator.wait()
                    hub.wait_for_live({("rig_sim", rig) for rig in rigs}, 120.0)
                    yield lab
                finally:
                    iterator.end()


@contextmanager
def killed_at(lab, recording, step, *, stored, later):
    """Kill the iterator when it commits a step: before it is stored or after, at once or a moment later."""
    killed = threading.Event()

    def kill():
        lab.iterator.kill()
        killed.set()

    def watch(name, number, is_stored):
        if (name, number, is_stored) != (recording, step, stored) or killed.is_set():
            return
        if later:
            threading.Timer(later, kill).start()
            return
        kill()
        if not stored:
            raise FaultError(query_pb2.FAULT_CODE_UNAVAILABLE, "Too late.")

    lab.recorder.watch = watch
    try:
        yield killed
    finally:
        lab.recorder.watch = lambda *_: None


def resumed(lab, id):
    """Ask for it as soon as the rig has come to rest from what was cut off."""
    until = time.monotonic() + 10.0
    while True:
        try:
            return lab.resume(id)
        except FaultError as fault:
            if fault.code != query_pb2.FAULT_CODE_BUSY or time.monotonic() > until:
                raise
            time.sleep(0.05)


def playbacks(lab, id):
    """What makes a campaign's result: drive and response of every playback, byte for byte, and its figures."""
    return [
        (step.iteration, step.drive.samples.data, step.response.samples.data, step.metrics.SerializeToString())
        for step in lab.recorder.read(id, iterator_pb2.IterationStep)
    ]
