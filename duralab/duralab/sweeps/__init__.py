"""Sweeps: comparison of many variants of a campaign, run on all cores or a cluster; needs `duralab[sweeps]`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from duralab.lazy_face import lazy_face

if TYPE_CHECKING:
    from duralab.sweeps.report import write_report
    from duralab.sweeps.results import PLAYBACKS, RESULTS, SweepResults, read_results
    from duralab.sweeps.sweep_file import CellKind, Kept, Objective, Sweep, load_sweep, shipped_sweeps
    from duralab.sweeps.sweeping import SweepForecast, SweepProgress, default_folder, forecast_sweep, run_sweep

__all__ = [
    "PLAYBACKS",
    "RESULTS",
    "CellKind",
    "Kept",
    "Objective",
    "Sweep",
    "SweepForecast",
    "SweepProgress",
    "SweepResults",
    "default_folder",
    "forecast_sweep",
    "load_sweep",
    "read_results",
    "run_sweep",
    "shipped_sweeps",
    "write_report",
]

__getattr__ = lazy_face(__name__)
