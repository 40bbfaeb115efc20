"""`duralab sweep`: many campaigns, with how far they are on the screen, and a report that compares them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from duralab.cli.json_output import console_beside, write_json
from duralab.cli.opening import open_hint
from duralab.errors import InputError, LabError
from duralab.sweeps import (
    PLAYBACKS,
    RESULTS,
    SweepProgress,
    SweepResults,
    default_folder,
    load_sweep,
    read_results,
    run_sweep,
    write_report,
)

REPORT: Final = "report.html"
_LINES: Final = 20
"""Lines that are printed of a whole sweep where there is no terminal."""


def sweep(
    source: str | None,
    *,
    out: Path | None,
    workers: int | None,
    scheduler: str | None,
    retry_failed: bool,
    report_of: Path | None,
    as_json: bool,
) -> None:
    """Run a sweep, or write the report of one; raises LabError where a campaign failed."""
    console = console_beside(as_json)
    if (source is None) == (report_of is None):
        raise InputError("Give either a sweep file to run, or --report with the folder of a sweep.")
    if report_of is not None:
        others = {"--out": out, "--workers": workers, "--scheduler": scheduler, "--retry-failed": retry_failed or None}
        if idle := [name for name, value in others.items() if value is not None]:
            raise InputError(f"--report only reads; {', '.join(idle)} is of a sweep that is run.")
        _conclude(console, read_results(report_of), as_json=as_json)
        return
    plan = load_sweep(str(source))
    folder = out or default_folder(plan)
    console.print(f"Sweep {plan.name} of campaign {plan.campaign}, into {folder}.", highlight=False, markup=False)
    try:
        with _Display(console) as display:
            run_sweep(
                plan,
                out=folder,
                workers=workers,
                scheduler=scheduler,
                retry_failed=retry_failed,
                on_progress=display.show,
            )
    except KeyboardInterrupt:
        console.print("What has ended is kept; the same command goes on from there.", highlight=False)
        raise
    results = read_results(folder)
    _conclude(console, results, as_json=as_json)
    if results.failed:
        raise LabError(
            f"{len(results.failed)} of {results.total} campaigns failed, the first with: "
            f"{results.failed[0]['sentence']} --retry-failed runs them again."
        )


def _conclude(console: Console, results: SweepResults, *, as_json: bool) -> None:
    report = write_report(results, results.folder / REPORT)
    ended, best = len(results.rows), results.best
    console.print(f"{ended} of {results.total} campaigns ended, {len(results.failed)} of them failed.", highlight=False)
    if best is not None:
        figure = results.objective.value
        console.print(
            f"Best {figure.replace('_', ' ')} {best[figure]:.4f}: {settings_in_words(results.keys, best)}\n"
            f"{best['sentence']}",
            highlight=False,
            markup=False,
        )
    rows = (("report", report, open_hint(report)), ("figures", results.folder / RESULTS, f"and {PLAYBACKS} beside it"))
    for name, path, hint in rows:
        console.print(f"{name:<10} {path}   {hint}", highlight=False, markup=False, soft_wrap=True)
    if as_json:
        write_json(
            {
                "sweep": results.folder,
                "ended": ended,
                "total": results.total,
                "failed": results.failed,
                "objective": results.objective,
                "best": best,
                "report": report,
                "figures": results.folder / RESULTS,
            }
        )


def settings_in_words(keys: tuple[str, ...], row: Mapping[str, Any]) -> str:
    """Return the settings of a point in one line."""
    return ", ".join(f"{key} {row[key]:g}" if isinstance(row[key], float) else f"{key} {row[key]}" for key in keys)


class _Display:
    """A bar while campaigns run; a line now and then where there is no terminal."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._said = -1
        self._progress = Progress(
            SpinnerColumn(),
            TextColumn("campaigns"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.description}"),
            console=console,
            disable=not console.is_terminal,
        )
        self._task = self._progress.add_task("starting the workers", total=None)

    def show(self, progress: SweepProgress) -> None:
        """Show how far the sweep is."""
        found = [f"{progress.failed} failed"] if progress.failed else []
        if progress.best is not None:
            told = settings_in_words(tuple(progress.best_settings), progress.best_settings)
            found.append(f"best {progress.best:.4f} with {told}")
        words = ", ".join(found)
        self._progress.update(self._task, total=progress.total, completed=progress.ended, description=words)
        step = progress.ended * _LINES // max(1, progress.total)
        if not self._console.is_terminal and step != self._said:
            self._said = step
            self._console.print(
                f"{progress.ended}/{progress.total} campaigns{': ' if words else ''}{words}",
                highlight=False,
                markup=False,
            )

    def __enter__(self) -> _Display:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
