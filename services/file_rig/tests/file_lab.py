"""A map of two drives, file_rig as a process, and a quick controller that plays every order once."""

import json
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np

import duralab_bus
from duralab_drive_files import (
    TimeHistory,
    read_controller_map,
    read_order,
    read_rpc3,
    sampled_at,
    write_rpc3,
)
from duralab_gateway import SERVICE
from duralab_proto.arrays import from_record, to_record
from duralab_proto.v1 import rig_pb2

RATE = 500.0
MAP = """
rig: beam
controller: a controller
sample_rate: 500
controller_rate: 512
lead: 0.5
drives:
  lift: {channel: Lift, kind: displacement, unit: mm, sign: -1, minimum: -100, maximum: 100, slew_limit: 5000,
         recorded_command: Lift Cmd}
  push: {channel: Push, kind: force, unit: kN, minimum: -20, maximum: 20, slew_limit: 1000, recorded_command: Push Cmd}
responses:
  strain: {channel: SG 1, kind: strain, unit: microstrain, minimum: -200000, maximum: 200000}
  load: {channel: Load, kind: force, unit: kN, offset: 0.2, minimum: -50, maximum: 50}
channels:
  sensors:
    load: {serial_number: A17, abort_level: 5000}
  calculated:
    - {name: twice, kind: force, weights: {load: 2.0}}
"""
MIX = np.array([[2.0e-2, 3.0e-8], [2.0e4, 0.4]])
WAIT = 60.0


def gentle(seconds=3.0, seed=0):
    """A drive of random lines below 15 Hz that begins and ends at zero."""
    random, count = np.random.default_rng(seed), round(RATE * seconds)
    at = np.arange(count) / RATE
    lines = np.arange(1.0, 15.0, 0.5)
    phases = random.uniform(0.0, 2.0 * np.pi, (2, lines.size, 1))
    drive = np.sin(2.0 * np.pi * lines[:, None] * at + phases).sum(axis=1) * np.sin(np.pi * at / at[-1]) ** 2
    return drive / np.abs(drive).max(axis=1, keepdims=True) * [[0.05], [5000.0]]


def truth(drive, gain=1.005):
    measured = MIX @ (gain * drive)
    return np.vstack([measured, 2.0 * measured[1:]])


def until(condition):
    deadline = time.monotonic() + WAIT
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return found


class Controller:
    """Plays each order of an exchange folder once: late by 37.4 samples, with a gain error, at 1024 Hz, in int16."""

    def __init__(self, controller_map, *, delay=37.4, gain=1.005, real_time=False):
        self.map, self.delay, self.gain, self.real_time = controller_map, delay, gain, real_time
        self.played = []
        self._ended = threading.Event()

    def run(self):
        while not self._ended.wait(0.02):
            for path in sorted((self.map.exchange / "outbox").glob("*.json")):
                if path.stem not in self.played:
                    self.played.append(path.stem)
                    self.play(read_order(path))

    def play(self, order):
        history = read_rpc3(self.map.exchange / "outbox" / order.drive_file)
        played = self.gain * self.map.drives_from_controller(history)
        seconds = history.samples.shape[1] / history.sample_rate + self.delay / RATE
        if self.real_time and self._ended.wait(seconds):
            return
        times = np.arange(int(seconds * 1024.0)) / 1024.0 - self.delay / RATE
        both = sampled_at(np.vstack([played, MIX @ played]), history.sample_rate, times, new_rate=1024.0)
        rows = [self.map.drives_to_controller(both[:2]), self.map.responses_to_controller(both[2:])]
        path = self.map.exchange / "inbox" / order.response_file
        units = ("mm", "kN", "microstrain", "kN")
        # Without it, and without noise, two runs of one drive would have the same file.
        about = {"OPERATION": order.run}
        history = TimeHistory(order.wanted_channels, units, 1024.0, np.vstack(rows), about)
        write_rpc3(history, path.with_suffix(".part"))
        path.with_suffix(".part").replace(path)

    @contextmanager
    def running(self):
        thread = threading.Thread(target=self.run)
        thread.start()
        try:
            yield self
        finally:
            self._ended.set()
            thread.join()


class FileLab:
    """A bus with file_rig as a process."""

    def __init__(self, folder, text=MAP):
        self.folder = folder
        path = folder / "beam.yaml"
        path.write_text(text)
        self.map = read_controller_map(path)
        self.outbox, self.inbox = self.map.exchange / "outbox", self.map.exchange / "inbox"
        self.bus = duralab_bus.open_bus(duralab_bus.BusConfig(listen=("tcp/127.0.0.1:0",)), service="client")
        self.config = folder / "file_rig.json"
        content = {
            "bus": {"connect": list(self.bus.listening[:1])},
            "exit_with_parent": True,
            "maps": [str(path)],
            "spool_folder": str(folder / "spool"),
        }
        self.config.write_text(json.dumps(content))
        self.process = None

    def start(self):
        asked = [sys.executable, "-m", "file_rig", "--config", str(self.config)]
        with (self.folder / "log").open("ab") as log:
            self.process = subprocess.Popen(asked, stdin=subprocess.PIPE, stdout=log, stderr=log)
        self.bus.wait_for_live({(SERVICE, "beam")}, WAIT)

    def end(self, *, kill):
        (self.process.kill if kill else self.process.terminate)()
        self.process.wait(WAIT)
        self.process.stdin.close()
        until(lambda: (SERVICE, "beam") not in self.bus.live(SERVICE))

    def close(self):
        self.end(kill=False)
        self.bus.close()

    def ask(self, key, request, answer=rig_pb2.RigState, **options):
        return self.bus.query(key("beam"), request, answer, **options)

    def state(self):
        return self.ask(self.bus.keys.rig_state, rig_pb2.StateRequest())

    def stop(self, reason):
        return self.ask(self.bus.keys.rig_stop, rig_pb2.StopRequest(reason=reason))

    def told(self):
        return self.ask(self.bus.keys.rig_description, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)

    def request(self, run, drive, seed=1):
        return rig_pb2.PlayRequest(run=run, drive=to_record(list(self.told().drives), RATE, drive), seed=seed)

    def play(self, run, drive, *, seed=1, **options):
        return self.ask(self.bus.keys.rig_play, self.request(run, drive, seed), rig_pb2.PlayResult, **options)

    def waits(self):
        return until(lambda: state if (state := self.state()).mode == rig_pb2.RIG_MODE_WAITING else None)


def close_to(result, wanted):
    """Check that the response of a result is the wanted one to a thousandth."""
    found = from_record(result.response)[2]
    error = np.sqrt(((found - wanted) ** 2).sum(axis=1) / (wanted**2).sum(axis=1))
    assert error.max() < 1.0e-3, error
