"""All checks of this machine, each given the facts that it judges."""

from __future__ import annotations

import locale
import os
import shutil
import struct
import sys
import tempfile
from ctypes.util import find_library
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from duralab.diagnosis.checks import (
    OWN,
    Finding,
    check_bus,
    check_command,
    check_disk,
    check_graphics,
    check_locale,
    check_lock,
    check_own_versions,
    check_ports,
    check_python,
    check_requirements,
    check_services,
    check_shadows,
    check_temporary,
    check_viewer,
    check_writable,
    free_bytes,
    locked_versions,
    named,
    ports_free,
    vulkan_drivers,
)
from duralab.errors import InputError
from duralab.processes import has_display, notes_folder, running_labs, viewer_program

_LOCK: Final = "requirements.lock"


def examine(recordings: Path) -> list[Finding]:
    """Look at everything that a lab needs of this machine; `recordings` is the folder for recordings."""
    installed = named((found.metadata["Name"], found.version) for found in metadata.distributions())
    temporary = Path(tempfile.gettempdir())
    return [
        check_python(sys.version_info[:3], pointer_bits=8 * struct.calcsize("P"), executable=sys.executable),
        check_services(lambda name: find_spec(name) is not None, executable=sys.executable),
        check_shadows(Path.cwd(), paths=os.environ.get("PYTHONPATH", "").split(os.pathsep)),
        check_command(shutil.which("duralab"), prefix=Path(sys.prefix)),
        check_own_versions(installed),
        check_requirements(_requirements(), installed),
        check_lock(_locked(), installed),
        check_disk(recordings.absolute(), free=free_bytes(recordings)),
        check_writable("recordings", recordings.absolute(), remedy="Give another folder with --recordings DIR."),
        check_temporary(temporary, free=free_bytes(temporary)),
        check_writable("state", notes_folder(), remedy="Set XDG_STATE_HOME to a folder that you may write."),
        check_locale(locale.getpreferredencoding(do_setlocale=False), file_names=sys.getfilesystemencoding()),
        check_bus(),
        *check_ports([lab.endpoint for lab in running_labs()], is_free=ports_free()),
        check_viewer(_viewer()),
        check_graphics(
            system=sys.platform,
            display=has_display(),
            library=find_library("vulkan"),
            drivers=vulkan_drivers(os.environ, home=Path.home()),
        ),
    ]


def _requirements() -> list[str]:
    """Return what the lab's distributions ask for, as far as they are installed."""
    found: list[str] = []
    for name in OWN:
        try:
            found += metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue
    return found


def _locked() -> dict[str, set[str]]:
    """Return what the lock of a source tree allows; nothing where the lab was installed without one."""
    for folder in Path(__file__).resolve().parents:
        if (folder / _LOCK).is_file() and (folder / "Makefile").is_file():
            return locked_versions((folder / _LOCK).read_text(encoding="utf-8"))
    return {}


def _viewer() -> Path | None:
    try:
        return viewer_program()
    except InputError:
        return None
