"""`duralab sweep`: many campaigns, with how far they are on the screen, and a report that compares them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from duralab.cli.options import Json
from duralab.cli.output import Output, open_hint
from duralab.errors import InputError, LabError

if TYPE_CHECKING:
    from duralab.sweeps import SweepForecast, SweepProgress, SweepResults

REPORT: Final = "report.html"
_LINES: Final = 20
"""Lines that are printed of a whole sweep where there is no terminal."""


def complete_sweep(incomplete: str) -> list[str]:
    """Return the shipped sweeps with this beginning; the shell completes files itself."""
    from duralab.sweeps import shipped_sweeps

    return [name for name in shipped_sweeps() if name.startswith(incomplete)]


def sweep(
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="SWEEP",
            help="A sweep file, or a shipped one, such as fifty_gains_and_seeds.",
            show_default=False,
            autocompletion=complete_sweep,
        ),
    ] = None,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder of the sweep; out/sweeps/<name> if left out.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, metavar="N", help="Campaigns at once; one per core if left out.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Use the workers of a Dask scheduler, tcp://….")
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run failed campaigns again.")] = False,
    at_most: Annotated[
        int | None,
        typer.Option("--at-most", min=1, metavar="N", help="Run so many campaigns now; all that remain if left out."),
    ] = None,
    forecast: Annotated[
        bool, typer.Option("--forecast", help="Run nothing; show the time and the disk space that remain.")
    ] = False,
    report_of: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Only write the report of the sweep in this folder.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Run or continue many campaigns and compare them; needs duralab[sweeps]."""
    from duralab.sweeps import default_folder, forecast_sweep, load_sweep, read_results, run_sweep

    output = Output(as_json)
    if (source is None) == (report_of is None):
        raise InputError("Give either a sweep file to run, or --report with the folder of a sweep.")
    if report_of is not None:
        others = {
            "--out": out,
            "--workers": workers,
            "--scheduler": scheduler,
            "--retry-failed": retry_failed or None,
            "--at-most": at_most,
            "--forecast": forecast or None,
        }
        if idle := [name for name, value in others.items() if value is not None]:
            raise InputError(f"--report only reads, and {', '.join(idle)} belongs to a run; leave it out.")
        _conclude(output, read_results(report_of))
        return
    plan = load_sweep(str(source))
    output.say(*plan.remarks)
    folder = out or default_folder(plan)
    if forecast:
        if at_most is not None or scheduler is not None:
            raise InputError("--forecast runs nothing; leave out --at-most and --scheduler.", field="forecast")
        _show_forecast(output, forecast_sweep(plan, out=folder, workers=workers))
        return
    output.say(f"Sweep {plan.name} of campaign {plan.campaign}, into {folder}.")
    try:
        with _Display(output) as display:
            run_sweep(
                plan,
                out=folder,
                workers=workers,
                scheduler=scheduler,
                retry_failed=retry_failed,
                at_most=at_most,
                on_progress=display.show,
            )
    except KeyboardInterrupt:
        output.say("What has ended is kept; the same command continues from there.")
        raise
    results = read_results(folder)
    _conclude(output, results)
    if results.failed:
        raise LabError(
            f"{len(results.failed)} of {results.total} campaigns failed, the first with: "
            f"{results.failed[0]['sentence']} --retry-failed runs them again."
        )


def _show_forecast(output: Output, found: SweepForecast) -> None:
    remain = found.total - found.ended
    output.say(f"{found.total:,} campaigns: {found.ended:,} have ended, {found.failed:,} of them failed.")
    if found.seconds_each is None or found.seconds_left is None:
        output.say("No campaign has finished yet, so time and space are not known; run some first: --at-most 8.")
    else:
        kept = found.bytes_each or 0.0
        output.say(
            f"A campaign takes {found.seconds_each:.1f} s on a worker and keeps {kept / 1e6:.1f} MB: the remaining "
            f"{remain:,} take {timedelta(seconds=round(found.seconds_left))} on {found.workers} workers and "
            f"{kept * remain / 1e9:.1f} GB; {found.free_bytes / 1e9:.1f} GB are free."
        )
        if kept * remain > found.free_bytes:
            output.say("That is more than is free: `keep: figures` in the sweep file keeps no recordings.")
    output.document(
        {
            "total": found.total,
            "ended": found.ended,
            "failed": found.failed,
            "workers": found.workers,
            "seconds_each": found.seconds_each,
            "seconds_left": found.seconds_left,
            "bytes_each": found.bytes_each,
            "bytes_left": found.bytes_left,
            "free_bytes": found.free_bytes,
        }
    )


def _conclude(output: Output, results: SweepResults) -> None:
    from duralab.sweeps import PLAYBACKS, RESULTS, write_report

    report = write_report(results, results.folder / REPORT)
    ended, best = len(results.rows), results.best
    output.say(f"{ended} of {results.total} campaigns ended, {len(results.failed)} of them failed.")
    if best is not None:
        figure = results.objective.value
        output.say(
            f"Best {figure.replace('_', ' ')} {best[figure]:.4f}: {settings_in_words(results.keys, best)}\n"
            f"{best['sentence']}"
        )
    rows = (("report", report, open_hint(report)), ("figures", results.folder / RESULTS, f"and {PLAYBACKS} beside it"))
    output.say(*(f"{name:<10} {path}   {hint}" for name, path, hint in rows))
    output.document(
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

    def __init__(self, output: Output) -> None:
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            SpinnerColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        self._output = output
        self._said = -1
        self._progress = Progress(
            SpinnerColumn(),
            TextColumn("campaigns"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.description}"),
            console=output.console,
            disable=not output.console.is_terminal,
        )
        self._task = self._progress.add_task("starting the workers", total=None)

    def show(self, progress: SweepProgress) -> None:
        """Show how far the sweep is."""
        found = [f"{progress.failed} failed"] if progress.failed else []
        if progress.best is not None:
            settings = settings_in_words(tuple(progress.best_settings), progress.best_settings)
            found.append(f"best {progress.best:.4f} with {settings}")
        words = ", ".join(found)
        self._progress.update(self._task, total=progress.total, completed=progress.ended, description=words)
        step = progress.ended * _LINES // max(1, progress.total)
        if not self._output.console.is_terminal and step != self._said:
            self._said = step
            self._output.say(f"{progress.ended}/{progress.total} campaigns{': ' if words else ''}{words}")

    def __enter__(self) -> _Display:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
