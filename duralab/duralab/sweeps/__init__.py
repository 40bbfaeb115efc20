"""Sweeps: one campaign many times, on all cores or on a cluster, compared; needs the extra `duralab[sweeps]`."""

from duralab.sweeps.sweep_file import CellKind, Kept, Objective, Sweep
from duralab.sweeps.sweep_loading import load_sweep, shipped_sweeps

__all__ = ["CellKind", "Kept", "Objective", "Sweep", "load_sweep", "shipped_sweeps"]
