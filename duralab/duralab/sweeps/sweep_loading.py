"""Reading a sweep file: from YAML text to a checked `Sweep`."""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

from duralab.errors import InputError
from duralab.near_files import did_you_mean
from duralab.sweeps.sweep_file import Sweep
from duralab_bus import ConfigError, load_config
from duralab_settings import read_yaml_text

_SUFFIX = ".yaml"


def shipped_sweeps() -> list[str]:
    """Return the names of the sweeps that come with the package."""
    entries = (files("duralab.sweeps") / "shipped").iterdir()
    return sorted(entry.name.removesuffix(_SUFFIX) for entry in entries if entry.name.endswith(_SUFFIX))


def load_sweep(source: str | Path) -> Sweep:
    """Read and check a sweep file.

    `source`: Path of a YAML file, or the name of a sweep that comes with the package, e.g. "fifty_gains_and_seeds".
    Returns: With `folder` and `text` of the file.
    Raises `InputError`: There is no such file, it is no YAML, or a key or value in it is not allowed.
    """
    path = Path(source)
    if not path.exists() and str(source) in shipped_sweeps():
        # A shipped file has no folder of the user's own: its relative paths start where the user stands.
        with as_file(files("duralab.sweeps") / "shipped" / f"{source}{_SUFFIX}") as shipped:
            return _read(shipped, folder=Path())
    if not path.is_file():
        names = shipped_sweeps()
        raise InputError(
            f"There is no sweep file {str(source)!r}; give the path of one, or a shipped one: "
            f"{', '.join(names)}{did_you_mean(path, names=names)}"
        )
    return _read(path, folder=path.parent)


def _read(path: Path, *, folder: Path) -> Sweep:
    try:
        sweep = load_config(Sweep, path)
    except ConfigError as error:
        raise InputError(str(error)) from error
    return sweep.read_from(folder=folder, text=read_yaml_text(path))
