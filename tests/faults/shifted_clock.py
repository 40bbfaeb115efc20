"""The wall clock of the lab's processes, moved by the test at any moment; the machine's own stays as it is."""

from __future__ import annotations

import mmap
import shutil
import struct
import subprocess
from pathlib import Path

_SOURCE = Path(__file__).with_name("shifted_clock.c")
_OFFSET = struct.Struct("<q")


class ShiftedClock:
    """The shim that is preloaded into every service, and the file through which it is told the time."""

    def __init__(self, folder: Path) -> None:
        self._library = folder / "shifted_clock.so"
        self._file = folder / "clock_offset"
        compiler = compiler_found()
        if compiler is None:
            raise RuntimeError("There is no C compiler (cc) to build the clock's shim with.")
        subprocess.run([compiler, "-O1", "-shared", "-fPIC", "-o", self._library, _SOURCE, "-ldl"], check=True)
        self._file.write_bytes(_OFFSET.pack(0))
        with self._file.open("r+b") as stream:
            self._mapped = mmap.mmap(stream.fileno(), _OFFSET.size)

    @property
    def environment(self) -> dict[str, str]:
        return {"LD_PRELOAD": str(self._library), "SHIFTED_CLOCK": str(self._file)}

    def set_offset(self, seconds: float) -> None:
        self._mapped[:] = _OFFSET.pack(round(seconds * 1e9))


def compiler_found() -> str | None:
    return shutil.which("cc")
