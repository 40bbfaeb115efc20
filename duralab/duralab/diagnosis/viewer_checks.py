"""Whether the live viewer will open a window, and a graphics driver draw it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from duralab.diagnosis.finding import Finding, fine, warning

_SOFTWARE: Final = ("lvp", "swrast", "swiftshader", "vk_swiftshader")
"""Begin of the names of drivers that draw with the processor."""

_DRIVER_FOLDERS: Final = ("/etc/vulkan/icd.d", "/usr/share/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")


def check_viewer(program: Path | None) -> Finding:
    """Judge whether the viewer is installed; `program` is where, None where it is not."""
    if program is None:
        return warning("viewer", "The Rerun viewer is not installed.", "Install the package rerun-sdk to use --view.")
    return fine("viewer", str(program))


def check_graphics(*, system: str, display: bool, library: str | None, drivers: list[Path]) -> Finding:
    """Judge whether the viewer can draw in a window of its own."""
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
    """Return the descriptions of Vulkan drivers, as its loader looks for them."""
    for variable in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        if given := environment.get(variable):
            return [path for path in map(Path, given.split(":")) if path.is_file()]
    folders = [*map(Path, _DRIVER_FOLDERS), home / ".local/share/vulkan/icd.d"]
    return sorted(path for folder in folders for path in folder.glob("*.json"))
