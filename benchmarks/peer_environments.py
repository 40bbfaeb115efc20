"""Peers in environments of their own, made once under a folder: they are never a dependency."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
# SDynPy's local modelling needs modules that it does not ask for, and fails with numpy from 2.3 on.
PEERS = {
    "sdynpy": ("sdynpy==0.23.0", "numpy==2.2.6", "joblib==1.6.0", "psutil==7.2.2"),
    "pyfrf": ("pyFRF==1.5.0",),
    "rattlesnake": ("rattlesnake-vibration-controller==3.0.2",),
}


class PeerMissingError(RuntimeError):
    """A peer could not be installed or did not run; says why."""


def peer_arrays(name: str, script: str, *arguments: str, directory: Path) -> dict[str, np.ndarray]:
    """Run a script of this folder with a peer's Python, on one core, and return what it found.

    Parameters
    ----------
    name : str
        Of `PEERS`.
    script : str
        File name; it writes an .npz file to the path that is its last argument.
    arguments : str
        Before that.
    directory : Path
        Where the environments are kept.

    Returns
    -------
    dict of str to ndarray

    Raises
    ------
    PeerMissingError
        It cannot be installed, or fails.
    """
    environment = directory.resolve() / name
    python, result = environment / "bin" / "python", environment / "result.npz"
    try:
        if not python.exists():
            installer = str(ROOT / "scripts" / "uv.sh")
            _run([installer, "venv", "--quiet", "--python", sys.executable, str(environment)])
            _run([installer, "pip", "install", "--quiet", "--python", str(python), *PEERS[name]])
        run_on_one_core([str(python), str(ROOT / "benchmarks" / script), *arguments, str(result)])
    except subprocess.CalledProcessError as error:
        reason = (error.stderr or "").strip().splitlines()
        raise PeerMissingError(reason[-1] if reason else f"ended with code {error.returncode}") from error
    with np.load(result) as found:
        return dict(found)


def run_on_one_core(command: list[str]) -> str:
    """Run a command whose libraries take one thread each, and return what it wrote."""
    return _run(command, {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"})


def _run(command: list[str], environment: dict[str, str] | None = None) -> str:
    ran = subprocess.run(command, env={**os.environ, **(environment or {})}, capture_output=True, check=True, text=True)
    return ran.stdout
