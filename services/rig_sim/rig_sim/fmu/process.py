"""Process of an FMU, used by the service: pieces of a drive in, responses or an error out."""

from __future__ import annotations

import json
import select
import signal
import subprocess
import sys
import tempfile
from typing import IO, Any, cast

import numpy as np

from duralab_gateway.motion import when
from rig_sim.fmu import child
from rig_sim.fmu.model_description import FmuModel
from rig_sim.fmu.specimen import FmuSpecimen

#: Longest step or initialisation; a longer one is assumed never to end.
LONGEST_SILENCE_SECONDS = 10.0
_END_SECONDS = 2.0
_LONGEST_PRINTED = 160


class FmuError(RuntimeError):
    """Error of an FMU, as the end of a sentence that begins with its name."""


class FmuProcess:
    """A process that instantiates an FMU, and plays one drive on it."""

    def __init__(self, specimen: FmuSpecimen, model: FmuModel, folder: str) -> None:
        self._specimen, self._model, self._folder = specimen, model, folder
        self._printed = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `end`
        # A separate session: the Ctrl-C that ends a service lets it ramp down first.
        self._process = subprocess.Popen(
            [sys.executable, "-P", child.__file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._printed,
            bufsize=0,
            start_new_session=True,
        )
        self._ready = False
        still = np.zeros(len(specimen.drives))[:, None]
        settings = {
            "fmi": model.fmi,
            "folder": folder,
            "identifier": model.identifier,
            "token": model.token,
            "drives": model.drives.references,
            "responses": model.responses.references,
            "rest": self._to_fmu(still)[:, 0].tolist(),
            "start_values": model.start_values,
            "steps": specimen.steps,
            "step": 1.0 / (specimen.sample_rate * specimen.steps),
            "settling_samples": round(specimen.settling * specimen.sample_rate),
        }
        self._write(json.dumps(settings).encode())

    def play(self, drive: np.ndarray, first: int) -> np.ndarray:
        """Play (drives, samples + 1) from a sample on, the last column being only the end; return (responses, samples).

        Both in the channels' units. Raises `FmuError`.
        """
        if not self._ready:
            self._answer()
            self._ready = True
        self._write(np.ascontiguousarray(self._to_fmu(drive).T, dtype="<f8").tobytes())
        ports = self._model.responses
        measured = np.frombuffer(self._answer(), dtype="<f8").reshape(-1, len(ports.references)).T
        response = measured * ports.factor + ports.offset
        if not np.isfinite(response).all():
            sample, row = np.argwhere(~np.isfinite(response.T))[0]
            seconds = (first + sample) / self._specimen.sample_rate
            name = self._specimen.responses[row].name
            raise FmuError(f"gave {response[row, sample]} for {name} {when(seconds)}, which is no finite value")
        return response

    def _to_fmu(self, drive: np.ndarray) -> np.ndarray:
        return (drive - self._model.drives.offset) / self._model.drives.factor

    def end(self) -> None:
        """End the process, at once if it does not end on request."""
        for stream in (self._process.stdin, self._process.stdout):
            cast(IO[bytes], stream).close()
        try:
            self._process.wait(_END_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._printed.close()

    def _write(self, content: bytes) -> None:
        try:
            child.write_message(cast(Any, self._process.stdin), child.READY, content)
        except BrokenPipeError:
            # Its answer states why the process has ended.
            return

    def _answer(self) -> bytes:
        stream = cast(Any, self._process.stdout)
        while True:
            if not select.select([stream], [], [], LONGEST_SILENCE_SECONDS)[0]:
                self._process.kill()
                raise FmuError(f"did not answer for {LONGEST_SILENCE_SECONDS:g} s and was ended")
            message = child.read_message(stream)
            if message is None:
                raise FmuError(f"{self._death()}{self._last_words()}")
            kind, content = message
            if kind == child.ERROR:
                text = " ".join(content.decode(errors="replace").replace(f"{self._folder}/", "").split()).rstrip(".")
                raise FmuError(f"{text}{self._last_words()}")
            if kind == child.READY:
                return content

    def _death(self) -> str:
        try:
            code = self._process.wait(_END_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return "closed its output and was ended"
        return f"crashed ({signal.Signals(-code).name})" if code < 0 else f"ended its process with exit code {code}"

    def _last_words(self) -> str:
        """Return the last printed line of the process, in brackets."""
        self._printed.seek(0)
        lines = self._printed.read().decode(errors="replace").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return f" [{last[:_LONGEST_PRINTED]}]" if last else ""
