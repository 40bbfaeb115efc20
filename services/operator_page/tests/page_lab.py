"""A lab of real processes with a linear rig, pages of it as processes, and a client that is no browser."""

import http.client
import json
import os
import ssl
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import yaml

from duralab import Signals
from duralab.data import channels_of
from duralab.formats import write_signals
from duralab.testing import LinearRig, lab
from operator_page.accounts import HASHER

PASSWORDS = {"Ada": "correct horse battery", "Grace": "staple of the harbour", "Vera": "only looking, thanks"}
ROLES = {"Ada": "operator", "Grace": "operator", "Vera": "viewer"}
RIG = "linear"
# Also where the machine does much besides.
START_SECONDS = 180.0
PLANT = ((([2.0e4, 1.0e4], [1.0, -0.9]), ([2.0e3], [1.0, -0.5])), (([3.0e3], [1.0, -0.6]), ([3.0e4], [1.0, -0.7])))


def write_accounts(path: Path) -> Path:
    accounts = {name: {"role": ROLES[name], "password": HASHER.hash(word)} for name, word in PASSWORDS.items()}
    path.write_text(yaml.safe_dump({"accounts": accounts}))
    return path


def campaign(name="held", **changes):
    """A campaign of a few seconds that waits before each playback."""
    document = {
        "name": name,
        "rig": RIG,
        "seed": 7,
        "target": {"file": "target.rsp"},
        "excitation": {
            "kind": "random_orthogonal",
            "lowest_frequency": 0.5,
            "highest_frequency": 60.0,
            "corner_frequency": 5.0,
            "decibels_per_octave": 6.0,
            "rms": 0.002,
            "duration": 20.0,
            "fade": 0.5,
            "delay_blocks": 1,
            "capture_blocks": 2,
        },
        "estimator": {"kind": "local_polynomial", "block_samples": 1024},
        "control_band": {"lowest_frequency": 1.0, "highest_frequency": 50.0},
        "update": {"kind": "basic_twr", "iteration_gain": 0.5},
        "stop": {"iterations": 4},
        "hold": "each",
    }
    return document | changes


def schedule(name="weeks", **changes):
    """A schedule of two drive files, a second and two long, with repeats enough for an hour in real time."""
    document = {
        "name": name,
        "rig": RIG,
        "events": {
            "rough": {"drive": "rough.drv", "target": "rough.rsp", "repeats": 1200},
            "smooth": {"drive": "smooth.drv", "target": "smooth.rsp", "repeats": 600},
        },
        "keep": {"first": 1, "every": None, "around_alarm": 1},
        "monitoring": {"baseline_repeats": 6, "bands": [1.0, 10.0, 40.0]},
    }
    return document | changes


def some_drive(samples: int, *, level: float = 0.004) -> np.ndarray:
    """Return drives that the rig can play, shape (2, samples)."""
    from scipy import signal

    noise = np.random.default_rng(3).standard_normal((2, samples))
    drive = level * signal.sosfiltfilt(signal.butter(2, (1.5, 30.0), "bandpass", fs=1000.0, output="sos"), noise)
    return drive * signal.windows.tukey(samples, 0.3)


def write_target(path: Path, rig: LinearRig, *, samples: int = 6000) -> Path:
    """Write responses that the rig can make, at 1 kHz."""
    _write(path, rig.responses, rig.respond(some_drive(samples)))
    return path


def _write(path: Path, channels, samples: np.ndarray) -> None:
    write_signals(Signals(channels_of(channels), 1000.0, samples), path, data_type="floating_point", overwrite=True)


class PageProcess:
    """`python -m operator_page` with a configuration of one's own."""

    def __init__(self, endpoint: str, folder: Path, **config) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self._log = folder, folder / "page.log"
        settings = {
            "bus": {"connect": [endpoint]},
            "exit_with_parent": True,
            "port": 0,
            "folder": str(folder / "files"),
        }
        self._config = folder / "page.yaml"
        self._settings = settings | config
        self.start()

    def start(self) -> None:
        self._config.write_text(yaml.safe_dump(self._settings))
        with self._log.open("wb") as log:
            command = [sys.executable, "-m", "operator_page", "--config", str(self._config)]
            self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=log, stderr=log)
        end = time.monotonic() + START_SECONDS
        while not (found := [line for line in self.log if line.get("event") == "page"]) or not any(
            line.get("event") == "ready" for line in self.log
        ):
            assert self.process.poll() is None, self._log.read_text()
            assert time.monotonic() < end, self._log.read_text()
            time.sleep(0.05)
        self.address = found[0]["address"]
        # Where it is started again it is found at the same place.
        self._settings["port"] = int(self.address.rstrip("/").rpartition(":")[2])

    @property
    def log(self):
        lines = self._log.read_text().splitlines()
        return [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]

    @property
    def files(self) -> Path:
        return self.folder / "files"

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait(10.0)
        self.process.stdin.close()


class Client:
    """What a browser does, without one."""

    def __init__(self, address: str, tls: ssl.SSLContext | None = None) -> None:
        self.host = address.partition("://")[2].rstrip("/")
        self._tls = tls
        self.cookie = self.token = self.version = ""
        self.open()

    def open(self) -> dict:
        document = self.get("/api/session")[1]
        self.version, self.token = document["version"], document.get("token", "")
        return document

    def sign_in(self, name: str, password: str | None = None):
        answer = self.post("/api/sign_in", {"name": name, "password": password or PASSWORDS[name]})
        self.token = answer[1].get("token", self.token)
        return answer

    def _connection(self):
        if self._tls is None:
            return http.client.HTTPConnection(self.host, timeout=120.0)
        return http.client.HTTPSConnection(self.host, timeout=120.0, context=self._tls)

    def request(self, method: str, path: str, body=None, headers=None):
        connection = self._connection()
        try:
            given = {"Cookie": f"duralab_session={self.cookie}"} if self.cookie else {}
            connection.request(method, path, body, given | (headers or {}))
            answer = connection.getresponse()
            if (cookie := answer.getheader("set-cookie")) is not None:
                self.cookie = cookie.partition(";")[0].partition("=")[2].strip('"')
            content = answer.read()
            document = json.loads(content) if answer.getheader("content-type") == "application/json" else content
            return answer.status, document, dict(answer.getheaders())
        finally:
            connection.close()

    def get(self, path: str):
        return self.request("GET", path)[:2]

    def post(self, path: str, values=None, **headers):
        own = {"Content-Type": "application/json", "X-Duralab-Page": self.version, "X-Duralab-Token": self.token}
        given = own | {name.replace("_", "-"): value for name, value in headers.items()}
        return self.request("POST", path, json.dumps(values or {}), given)[:2]

    def act(self, path: str, values=None, **also):
        """Do something in two acts."""
        status, armed = self.post("/api/arm", {"action": path, "values": values or {}, "seen": time.time()})
        if status != 200:
            return status, armed
        return self.post(path, {**(values or {}), "word": armed["word"], "seen": time.time(), **also})

    def lab(self) -> dict:
        """Return the first document of the stream."""
        connection = self._connection()
        try:
            connection.request("GET", "/api/stream", headers={"Cookie": f"duralab_session={self.cookie}"})
            answer = connection.getresponse()
            assert answer.status == 200
            kind = b""
            while line := answer.readline():
                kind = line if line.startswith(b"event: ") else kind
                if line.startswith(b"data: ") and kind == b"event: lab\n":
                    return json.loads(line.removeprefix(b"data: "))
            raise AssertionError("the stream ended")
        finally:
            connection.close()

    def wait_for(self, holds, *, seconds: float = 60.0) -> dict:
        end = time.monotonic() + seconds
        while not holds(document := self.lab()):
            assert time.monotonic() < end, {**document, "log": document["log"][-5:]}
            time.sleep(0.1)
        return document


class CrackingRig(LinearRig):
    """A linear rig whose first response grows by a half when its specimen cracks."""

    cracked = False

    def play(self, commands, run):
        response = super().play(commands, run)
        if self.cracked:
            response[0] *= 1.5
        return response


class PageLab:
    """The lab, and pages of it that are ended with it; `others`: Rigs beside the one that can crack."""

    def __init__(self, folder: Path, *others: LinearRig) -> None:
        self.folder, self._others = folder, others
        self.rig = CrackingRig(RIG, plant=PLANT, noise_rms=1.0)
        self._stack = ExitStack()

    def page(self, name: str, **config) -> PageProcess:
        page = PageProcess(self.lab.endpoints[0], self.folder / name, **config)
        self._stack.callback(page.close)
        return page

    def secured_page(self, name: str, **config) -> PageProcess:
        return self.page(name, accounts=str(write_accounts(self.folder / f"{name}.accounts.yaml")), **config)

    def put_campaign(self, page: PageProcess, document: dict, *, samples: int = 6000) -> None:
        write_target(page.files / "target.rsp", self.rig, samples=samples)
        (page.files / f"{document['name']}.yaml").write_text(yaml.safe_dump(document, sort_keys=False))

    def put_schedule(self, page: PageProcess, document: dict) -> None:
        for name, samples, level in (("rough", 2000, 0.004), ("smooth", 1000, 0.002)):
            drive = some_drive(samples, level=level)
            _write(page.files / f"{name}.drv", self.rig.drives, drive)
            _write(page.files / f"{name}.rsp", self.rig.responses, self.rig.respond(drive))
        (page.files / f"{document['name']}.yaml").write_text(yaml.safe_dump(document, sort_keys=False))

    def __enter__(self):
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        self.lab = self._stack.enter_context(lab(self.rig, *self._others, out=self.folder / "lab", endurance=True))
        return self

    def __exit__(self, *_):
        self._stack.close()
