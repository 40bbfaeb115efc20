"""Process of an FMU: a script, so that foreign code is isolated with fmpy and cannot crash the service.

It reads the settings as JSON and then pieces of a drive from standard input, and answers on standard output; each is
a `HEAD` and its bytes. A piece is (samples + 1, drives) float64, whose last row is only the end of the last sample;
(samples, responses).
"""

from __future__ import annotations

import ctypes
import json
import os
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, BinaryIO, Final

#: Kind of the message, and number of the bytes that follow.
HEAD: Final = struct.Struct("<cI")
READY: Final = b"R"
ALIVE: Final = b"A"
ERROR: Final = b"E"
#: Interval of messages that show that the process is alive, in s.
ALIVE_SECONDS: Final = 1.0
_WARNING = 1
_DOUBLE = 8


class FmuPlayer:
    """An instantiated and settled FMU."""

    def __init__(self, settings: dict[str, Any], alive: Callable[[], None]) -> None:
        self._alive = alive
        self._width, self._height = len(settings["drives"]), len(settings["responses"])
        self._steps, self._step = settings["steps"], settings["step"]
        self._inputs = (ctypes.c_uint32 * self._width)(*settings["drives"])
        self._outputs = (ctypes.c_uint32 * self._height)(*settings["responses"])
        self._taken = 0
        self.fmu = fmu = _load(settings)
        fmi = settings["fmi"]
        values = "Real" if fmi == 2 else "Float64"
        # Called without fmpy's wrappers, which take many times as long as a small FMU.
        self._set = _function(fmu, f"fmi{fmi}Set{values}")
        self._get = _function(fmu, f"fmi{fmi}Get{values}")
        self._do_step = _function(fmu, f"fmi{fmi}DoStep", steps=True)
        # FMI 3.0 also gets the number of values, and returns more about a step.
        self._set_count = (self._width,) if fmi == 3 else ()
        self._get_count = (self._height,) if fmi == 3 else ()
        self._flags = (ctypes.c_bool * 3)() if fmi == 3 else None
        last, first = ctypes.c_double(), ctypes.addressof(self._flags) if self._flags is not None else 0
        self._step_tail = (first, first + 1, first + 2, ctypes.byref(last)) if fmi == 3 else ()
        setter = fmu.setReal if fmi == 2 else fmu.setFloat64
        if fmi == 2:
            fmu.setupExperiment(startTime=0.0)
        for reference, value in settings["start_values"]:
            setter([reference], [value])
        if fmi == 2:
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=0.0)
        setter(settings["drives"], settings["rest"])
        fmu.exitInitializationMode()
        if settling := settings["settling_samples"]:
            self.play(struct.pack(f"<{self._width}d", *settings["rest"]) * (settling + 1))

    def play(self, piece: bytes) -> bytes:
        """Play a piece and return its responses, each at the time of its drive sample."""
        width, height = self._width, self._height
        drive = (ctypes.c_double * (len(piece) // _DOUBLE)).from_buffer_copy(piece)
        samples = len(drive) // width - 1
        response = (ctypes.c_double * (samples * height))()
        between = (ctypes.c_double * width)()
        instance, first, measured = self.fmu.component, ctypes.addressof(drive), ctypes.addressof(response)
        alive = time.monotonic() + ALIVE_SECONDS
        for sample in range(samples):
            self._check(
                "set its inputs",
                self._set(instance, self._inputs, width, first + sample * width * _DOUBLE, *self._set_count),
            )
            self._check(
                "get its outputs",
                self._get(instance, self._outputs, height, measured + sample * height * _DOUBLE, *self._get_count),
            )
            for step in range(self._steps):
                if step:
                    # Linear between samples, as in every engine.
                    for row, here in enumerate(range(sample * width, (sample + 1) * width)):
                        between[row] = drive[here] + step / self._steps * (drive[here + width] - drive[here])
                    self._check("set its inputs", self._set(instance, self._inputs, width, between, *self._set_count))
                now = self._taken * self._step
                self._check("do a step", self._do_step(instance, now, self._step, True, *self._step_tail))
                if self._flags is not None and (self._flags[1] or self._flags[2]):
                    raise RuntimeError(f"ended its simulation automatically at its time {now:.3f} s")
                self._taken += 1
            if time.monotonic() > alive:
                self._alive()
                alive = time.monotonic() + ALIVE_SECONDS
        return bytes(response)

    def _check(self, what: str, status: int) -> None:
        if status > _WARNING:
            raise RuntimeError(f"failed to {what} at its time {self._taken * self._step:.3f} s (status {status})")


def _load(settings: dict[str, Any]) -> Any:
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

    fmu = (FMU2Slave if settings["fmi"] == 2 else FMU3Slave)(
        guid=settings["token"],
        unzipDirectory=settings["folder"],
        modelIdentifier=settings["identifier"],
        instanceName="rig",
    )
    fmu.instantiate()
    return fmu


def _function(fmu: Any, name: str, *, steps: bool = False) -> Any:
    # A function taken by its index is a separate object: fmpy's keeps its types.
    function = fmu.dll[name]
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    if steps:
        flag = ctypes.c_int if name.startswith("fmi2") else ctypes.c_bool
        types = [pointer, ctypes.c_double, ctypes.c_double, flag, pointer, pointer, pointer, pointer]
        function.argtypes = types if name.startswith("fmi3") else types[:4]
    else:
        types = [pointer, pointer, size, pointer, size]
        function.argtypes = types if name.startswith("fmi3") else types[:4]
    function.restype = ctypes.c_int
    return function


def read_message(stream: BinaryIO) -> tuple[bytes, bytes] | None:
    """Read a message, its kind and its bytes; None if the other end is closed."""
    head = stream.read(HEAD.size)
    if len(head) < HEAD.size:
        return None
    kind, size = HEAD.unpack(head)
    content = stream.read(size)
    return None if len(content) < size else (kind, content)


def write_message(stream: BinaryIO, kind: bytes, content: bytes = b"") -> None:
    """Write a message."""
    stream.write(HEAD.pack(kind, len(content)) + content)
    stream.flush()


def _end_with(parent: int) -> None:
    """End together with the parent process, also during a step that never returns."""
    while os.getppid() == parent:
        time.sleep(ALIVE_SECONDS)
    os._exit(1)


def main() -> None:
    """Play pieces until standard input ends."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    # Output printed by an FMU must not mix with the answers.
    os.dup2(2, 1)
    player = None
    try:
        while (request := read_message(requests)) is not None:
            if player is None:
                player, answer = FmuPlayer(json.loads(request[1]), lambda: write_message(answers, ALIVE)), b""
            else:
                answer = player.play(request[1])
            write_message(answers, READY, answer)
    except Exception as error:  # noqa: BLE001 - whatever it is, the rig says it
        write_message(answers, ERROR, (str(error) or type(error).__name__).encode())
        os._exit(1)
    if player is not None:
        player.fmu.terminate()
        player.fmu.freeInstance()
    os._exit(0)


if __name__ == "__main__":
    main()
