"""Checks of what a lab needs: Python, packages, disk, locale, loopback, ports, viewer."""

from __future__ import annotations

import codecs
import locale
import os
import re
import shutil
import socket
import struct
import sys
import tempfile
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from ctypes.util import find_library
from dataclasses import dataclass
from enum import StrEnum
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from duralab.errors import InputError
from duralab.lab import SERVICES
from duralab.processes import GRPC_PORT, WEB_PORT, has_display, notes_folder, running_labs, viewer_program
from duralab.python_version import python_fault
from duralab_bus import BusConfig, BusError, open_bus


class Severity(StrEnum):
    """Severity of a finding."""

    FINE = "fine"
    WARNING = "warning"
    """A lab works, but a part of it does not, or will not for long."""
    PROBLEM = "problem"
    """No lab works before this is corrected."""


@dataclass(frozen=True)
class Finding:
    """Finding of one check; `remedy` is empty if nothing must be done."""

    check: str
    severity: Severity
    sentence: str
    remedy: str = ""


def fine(check: str, sentence: str) -> Finding:
    """Return a finding without a problem."""
    return Finding(check, Severity.FINE, sentence)


def warning(check: str, sentence: str, remedy: str) -> Finding:
    """Return a finding about a part that does not work, or will not for long, with the remedy."""
    return Finding(check, Severity.WARNING, sentence, remedy)


def problem(check: str, sentence: str, remedy: str) -> Finding:
    """Return a finding about a problem that prevents a lab from working, with the remedy."""
    return Finding(check, Severity.PROBLEM, sentence, remedy)


_POINTER_BITS: Final = 64


def check_python(version: tuple[int, ...], *, pointer_bits: int, executable: str) -> Finding:
    """Check the Python that runs this process and will run the services."""
    if (fault := python_fault(version)) is not None:
        return problem("Python", f"{executable}: {fault}", "Install one, and make the environment with it.")
    if pointer_bits != _POINTER_BITS:
        return problem(
            "Python",
            f"{executable} is a Python of {pointer_bits} bits; the rigs need one of {_POINTER_BITS}.",
            "Install a 64-bit Python and make the environment with it.",
        )
    return fine("Python", f"{'.'.join(str(part) for part in version)} at {executable}")


def check_services(is_installed: Callable[[str], bool], *, executable: str) -> Finding:
    """Check whether this Python can start every service; `is_installed` returns whether a module is installed."""
    missing = [name for name in SERVICES if not is_installed(name)]
    if missing:
        return problem(
            "services",
            f"{executable} has no {', '.join(missing)}: `duralab up` starts its services with this Python.",
            "Install them with `pip install 'duralab[lab]'`, or use the Python of an environment that has the lab.",
        )
    return fine("services", f"{', '.join(SERVICES)} are installed")


def check_shadows(folder: Path, *, paths: Sequence[str]) -> Finding:
    """Check whether a file in a folder, or on PYTHONPATH, hides a service of the same name."""
    places = [folder, *(Path(path) for path in paths if path)]
    found = [
        shadow
        for place in places
        for name in SERVICES
        for shadow in (place / f"{name}.py", place / name / "__init__.py")
        if shadow.is_file()
    ]
    if found:
        return problem(
            "names",
            f"{', '.join(str(path) for path in found)} would be started instead of the service of that name.",
            "Rename it, or run duralab in another folder and with PYTHONPATH unset.",
        )
    return fine("names", "nothing here hides a service")


def check_command(found: str | None, *, prefix: Path) -> Finding:
    """Check whether the command `duralab` found by a shell is of the Python at `prefix`."""
    if found is None:
        return warning(
            "command",
            "A shell does not find `duralab`.",
            f"Activate the environment, or type {prefix / 'bin' / 'duralab'}.",
        )
    if not Path(found).absolute().is_relative_to(prefix.absolute()):
        return warning(
            "command",
            f"A shell finds {found}, which belongs to another Python than {prefix}.",
            "Activate the environment that is meant, so that both are the same.",
        )
    return fine("command", found)


ON_THE_WIRE: Final = ("eclipse-zenoh", "protobuf")
"""Packages whose versions must match for communication between two machines."""

_MOST_SHOWN: Final = 5


def check_own_versions(installed: Mapping[str, str]) -> Finding:
    """Check whether Duralab's distributions have the same version; `installed` has versions by names."""
    found = {name: version for name, version in sorted(installed.items()) if _is_own(name)}
    if len(set(found.values())) > 1:
        listed = ", ".join(f"{name} {version}" for name, version in found.items())
        return problem("versions", f"Parts of the lab are of different versions: {listed}.", "Install all of one.")
    return fine("versions", f"duralab {found.get('duralab', 'of no version')}, all parts alike")


def check_requirements(required: Iterable[str], installed: Mapping[str, str]) -> Finding:
    """Check whether all required packages are installed."""
    names = {_name(requirement) for requirement in required if "extra ==" not in requirement}
    missing = sorted(name for name in names if name not in installed)
    if missing:
        return problem(
            "packages",
            f"Not installed: {', '.join(missing)}.",
            "Run `make setup`, or install them into this Python.",
        )
    return fine("packages", f"all {len(names)} that the lab asks for are installed")


def check_lock(locked: Mapping[str, set[str]], installed: Mapping[str, str]) -> Finding:
    """Check whether the packages have the tested versions."""
    if not locked:
        return fine("lock", "no requirements.lock beside this installation to compare with")
    others = {name: version for name, version in installed.items() if name in locked and version not in locked[name]}
    if not others:
        return fine("lock", f"{len(locked.keys() & installed.keys())} packages, all of the versions that were tested")
    wire = [name for name in ON_THE_WIRE if name in others]
    shown = [*wire, *(name for name in sorted(others) if name not in wire)][:_MOST_SHOWN]
    listed = ", ".join(f"{name} {others[name]} (tested: {', '.join(sorted(locked[name]))})" for name in shown)
    more = f" and {len(others) - len(shown)} more" if len(others) > len(shown) else ""
    judged = problem if wire else warning
    return judged("lock", f"Of other versions than tested: {listed}{more}.", "Run `make setup`.")


def locked_versions(text: str) -> dict[str, set[str]]:
    """Return the versions allowed by a requirements.lock, by names; a package may have one per Python version."""
    found: dict[str, set[str]] = {}
    for name, version in re.findall(r"(?m)^([A-Za-z0-9._-]+)==([^\s;\\]+)", text):
        found.setdefault(_name(name), set()).add(version)
    return found


def _name(requirement: str) -> str:
    """Return the normalised name in a requirement."""
    match = re.match(r"[A-Za-z0-9._-]+", requirement)
    return re.sub(r"[-_.]+", "-", match[0] if match else requirement).lower()


def named(versions: Iterable[tuple[str | None, str]]) -> dict[str, str]:
    """Return versions by normalised names."""
    return {_name(name): version for name, version in versions if name}


MEBIBYTE: Final = 1024 * 1024

RECORDER_KEEPS_FREE: Final = 256 * MEBIBYTE
"""Free space below which the recorder waits, so that the system keeps some space."""

COMFORTABLE: Final = 2048 * MEBIBYTE
"""Free space without a warning: seventeen times the 118 MiB of the shipped demo."""

TEMPORARY_NEEDS: Final = 64 * MEBIBYTE
"""Space for the services' settings, and for a live view rebuilt from a recording."""


def check_disk(folder: Path, *, free: int) -> Finding:
    """Check the free space on a disk."""
    sentence = f"{free / MEBIBYTE:,.0f} MiB are free for recordings in {folder}"
    if free < RECORDER_KEEPS_FREE:
        return problem(
            "disk",
            f"Only {sentence}; the recorder keeps {RECORDER_KEEPS_FREE // MEBIBYTE} MiB free and waits below that.",
            "Make room, or give another disk with `duralab up --recordings DIR`.",
        )
    if free < COMFORTABLE:
        return warning("disk", f"Only {sentence}.", "Make room before a long campaign, or give --recordings.")
    return fine("disk", sentence)


def check_writable(check: str, folder: Path, *, remedy: str) -> Finding:
    """Check whether a file can be made in a folder, or in its nearest existing parent."""
    place = nearest_folder(folder)
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        return problem(check, f"Nothing can be written in {place}: {error.strerror}.", remedy)
    return fine(check, f"{folder} can be written")


def check_temporary(folder: Path, *, free: int) -> Finding:
    """Check the folder for temporary files, with its free bytes."""
    written = check_writable("temporary", folder, remedy="Set TMPDIR to a folder that you may write.")
    if written.remedy:
        return written
    if free < TEMPORARY_NEEDS:
        return problem(
            "temporary",
            f"Only {free / MEBIBYTE:,.0f} MiB are free in {folder}; {TEMPORARY_NEEDS // MEBIBYTE} MiB are needed.",
            "Make room there, or set TMPDIR to a folder on another disk.",
        )
    return fine("temporary", f"{folder}, {free / MEBIBYTE:,.0f} MiB free")


def check_locale(encoding: str, *, file_names: str) -> Finding:
    """Check the encodings of text and file names."""
    wrong = [name for name in (encoding, file_names) if not _is_utf_8(name)]
    if wrong:
        return warning(
            "locale",
            f"Text is written as {', '.join(dict.fromkeys(wrong))}; some characters will be shown as question marks.",
            "Set LC_ALL to a locale of UTF-8, e.g. C.UTF-8, or set PYTHONUTF8=1.",
        )
    return fine("locale", "UTF-8")


def _is_utf_8(name: str) -> bool:
    try:
        return codecs.lookup(name).name == "utf-8"
    except LookupError:
        return False


def nearest_folder(folder: Path) -> Path:
    """Return a folder, or its nearest existing parent."""
    place = folder.absolute()
    while not place.is_dir() and place != place.parent:
        place = place.parent
    return place


def free_bytes(folder: Path) -> int:
    """Return the bytes free for this user on the disk of a folder, which need not exist."""
    import shutil

    return shutil.disk_usage(os.fspath(nearest_folder(folder))).free


LAB_PORT: Final = 7474
LOOPBACK: Final = "127.0.0.1"


def check_bus() -> Finding:
    """Check whether two sessions on loopback find each other."""
    try:
        with (
            open_bus(BusConfig(), service="duralab") as first,
            open_bus(BusConfig(connect=first.listening[:1]), service="duralab"),
        ):
            return fine("bus", f"two sessions met at {first.listening[0]}")
    except BusError as error:
        return problem("bus", str(error), f"Let programs on this machine connect to {LOOPBACK} (firewall, container).")


def check_ports(labs: Collection[str], *, is_free: dict[int, bool]) -> list[Finding]:
    """Check the default ports of `duralab up` and the viewer."""
    findings = []
    if is_free[LAB_PORT]:
        findings.append(fine("lab's port", f"{LAB_PORT} is free"))
    elif any(endpoint.endswith(f":{LAB_PORT}") for endpoint in labs):
        findings.append(fine("lab's port", f"{LAB_PORT} is that of your lab, which runs"))
    else:
        findings.append(
            problem(
                "lab's port",
                f"The port {LAB_PORT} is in use by another program, or by another user's lab.",
                f"End that one, or choose another: `duralab up --listen tcp/{LOOPBACK}:7475`.",
            )
        )
    taken = [port for port in (GRPC_PORT, WEB_PORT) if not is_free[port]]
    if taken:
        findings.append(
            warning(
                "viewer's ports",
                f"In use: {', '.join(str(port) for port in taken)}; another viewer may be open.",
                "Close it, or choose others: `duralab view --port 0 --web-port 0` (--view does so by itself).",
            )
        )
    else:
        findings.append(fine("viewer's ports", f"{GRPC_PORT} and {WEB_PORT} are free"))
    return findings


def ports_free() -> dict[int, bool]:
    """Return whether each of the default ports is free."""
    return {port: _is_free(port) for port in (LAB_PORT, GRPC_PORT, WEB_PORT)}


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        # Same option as in the programs: a port in TIME_WAIT counts as free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError:
            return False
    return True


_SOFTWARE: Final = ("lvp", "swrast", "swiftshader", "vk_swiftshader")
"""Prefixes of the names of software drivers."""

_DRIVER_FOLDERS: Final = ("/etc/vulkan/icd.d", "/usr/share/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")


def check_viewer(program: Path | None) -> Finding:
    """Check whether the viewer is installed; `program` is its path, or None."""
    if program is None:
        return warning("viewer", "The Rerun viewer is not installed.", "Install the package rerun-sdk to use --view.")
    return fine("viewer", str(program))


def check_graphics(*, system: str, display: bool, library: str | None, drivers: list[Path]) -> Finding:
    """Check whether the viewer can draw in a window."""
    if system in ("darwin", "win32"):
        return fine("graphics", "the system's own driver")
    if not display:
        return fine("graphics", "no display here: the viewer is a page, and the browser that opens it draws")
    remedy = "Install the graphics driver (on Debian: mesa-vulkan-drivers), or use a browser: `duralab view --web`."
    if library is None:
        return warning("graphics", "There is a display but no Vulkan library (libvulkan.so.1).", remedy)
    if not drivers:
        return warning("graphics", "There is a display but no Vulkan driver is installed.", remedy)
    if all(path.name.startswith(_SOFTWARE) for path in drivers):
        return warning(
            "graphics",
            f"Only a driver that draws with the processor is installed ({', '.join(path.name for path in drivers)}): "
            "the viewer works, slowly, and takes the processor from the rigs.",
            "Install the driver of the graphics card where there is one.",
        )
    return fine("graphics", ", ".join(path.name for path in drivers))


def vulkan_drivers(environment: Mapping[str, str], *, home: Path) -> list[Path]:
    """Return the description files of Vulkan drivers, with the search order of Vulkan's loader."""
    for variable in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        if given := environment.get(variable):
            return [path for path in map(Path, given.split(":")) if path.is_file()]
    folders = [*map(Path, _DRIVER_FOLDERS), home / ".local/share/vulkan/icd.d"]
    return sorted(path for folder in folders for path in folder.glob("*.json"))


_LOCK: Final = "requirements.lock"


def examine(recordings: Path) -> list[Finding]:
    """Check all that a lab needs of this machine; `recordings` is the folder for recordings."""
    installed = named((found.metadata["Name"], found.version) for found in metadata.distributions())
    temporary = Path(tempfile.gettempdir())
    return [
        check_python(sys.version_info[:3], pointer_bits=8 * struct.calcsize("P"), executable=sys.executable),
        check_services(lambda name: find_spec(name) is not None, executable=sys.executable),
        check_shadows(Path.cwd(), paths=os.environ.get("PYTHONPATH", "").split(os.pathsep)),
        check_command(shutil.which("duralab"), prefix=Path(sys.prefix)),
        check_own_versions(installed),
        # Requirements of Duralab's installed distributions.
        check_requirements(
            [asked for name in installed if _is_own(name) for asked in metadata.requires(name) or ()], installed
        ),
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


def _is_own(name: str) -> bool:
    """Return whether a distribution is part of Duralab."""
    return name == "duralab" or name.startswith("duralab-")


def _locked() -> dict[str, set[str]]:
    """Return the versions in the lock of a source tree; empty for an installation without a lock."""
    for folder in Path(__file__).resolve().parents:
        if (folder / _LOCK).is_file() and (folder / "Makefile").is_file():
            return locked_versions((folder / _LOCK).read_text(encoding="utf-8"))
    return {}


def _viewer() -> Path | None:
    try:
        return viewer_program()
    except InputError:
        return None
