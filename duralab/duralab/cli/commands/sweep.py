"""`duralab sweep`: many campaigns, with how far they are on the screen, and a report that compares them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from duralab.cli.options import Json
from duralab.cli.output import Output, open_hint
from duralab.errors import InputError, LabError

if TYPE_CHECKING:
    from duralab.sweeps import SweepProgress, SweepResults

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
            help="A sweep file, or a shipped one: fifty_gains_and_seeds.",
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
    report_of: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="Only write the report of the sweep in this folder.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Run or continue many campaigns and compare them; needs duralab[sweeps]."""
    from duralab.sweeps import default_folder, load_sweep, read_results, run_sweep

    output = Output(as_json)
    if (source is None) == (report_of is None):
        raise InputError("Give either a sweep file to run, or --report with the folder of a sweep.")
    if report_of is not None:
        others = {"--out": out, "--workers": workers, "--scheduler": scheduler, "--retry-failed": retry_failed or None}
        if idle := [name for name, value in others.items() if value is not None]:
            raise InputError(f"--report only reads, and {', '.join(idle)} belongs to a run; leave it out.")
        _conclude(output, read_results(report_of))
        return
    plan = load_sweep(str(source))
    output.say(*plan.remarks)
    folder = out or default_folder(plan)
    output.say(f"Sweep {plan.name} of campaign {plan.campaign}, into {folder}.")
    try:
        with _Display(output) as display:
            run_sweep(
                plan,
                out=folder,
                workers=workers,
                scheduler=scheduler,
                retry_failed=retry_failed,
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
            told = settings_in_words(tuple(progress.best_settings), progress.best_settings)
            found.append(f"best {progress.best:.4f} with {told}")
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
