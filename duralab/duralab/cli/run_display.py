"""Display of a run's progress and of a campaign's result, for a terminal and as JSON."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final, Self

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from duralab.campaign import Judgement, judged_rows, repeatability_in_words
from duralab.cli.ending import ExitCode
from duralab.cli.output import Output, open_hint, own_command
from duralab.data import DAMAGE_SLOPES, counted_slope, damage_note, passes
from duralab.lab import CampaignResult, RunProgress, Stage
from duralab_bus import SpanKind, import_in_background, span

CAMPAIGN_STAGES: Final = (Stage.TARGET, Stage.CAMPAIGN)
"""What a run of a campaign works on, one after the other."""


class RunDisplay:
    """Progress bars of a run, one a stage; without a terminal one line for each new activity instead."""

    def __init__(
        self,
        console: Console,
        *,
        iterations: int | None = None,
        stages: Sequence[Stage] = CAMPAIGN_STAGES,
        endpoint: str = "",
    ) -> None:
        self._console = console
        self._endpoint = endpoint
        self._last_proposal = 0
        self._iterations = iterations
        self._last_line = ""
        self._progress = Progress(
            SpinnerColumn(),
            TextColumn(f"{{task.fields[title]:<{max(map(len, stages)) + 1}}}"),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            TextColumn("{task.fields[remaining]:>12}"),
            TimeElapsedColumn(),
            TextColumn("{task.description}", markup=False),
            console=console,
            disable=not console.is_terminal,
        )
        self._tasks = {
            stage: self._progress.add_task("", total=1.0, start=False, title=stage.value, remaining="")
            for stage in stages
        }
        self._report = self._progress.add_task("", total=None, start=False, visible=False, title="report", remaining="")

    def show(self, progress: RunProgress) -> None:
        """Show how far the run is."""
        for stage, earlier in self._tasks.items():
            if stage is progress.stage:
                break
            self._finish(earlier)
        task = self._tasks[progress.stage]
        self._progress.start_task(task)
        text = f"{progress.activity}{self._errors(progress)}"
        self._progress.update(
            task,
            completed=progress.fraction,
            description=text,
            remaining=remaining_words(progress.remaining_seconds),
        )
        if (not self._console.is_terminal and text != self._last_line) or progress.lasting:
            self._last_line = text
            self._console.print(f"{progress.stage}: {text}", highlight=False, markup=False)
        self._show_proposal(progress)

    def _show_proposal(self, progress: RunProgress) -> None:
        """Show once what is to be decided on, and how."""
        if (hold := progress.hold) is None or hold.number == self._last_proposal:
            return
        self._last_proposal = hold.number
        choice = "end" if hold.refusal else "play"
        command = f"{own_command()} decide {shlex.quote(progress.campaign)} {choice} --proposal {hold.number}"
        self._console.print(str(hold), highlight=False, markup=False)
        self._console.print(
            f"Decide: {command} --name NAME --reason TEXT --connect {shlex.quote(self._endpoint)}\n"
            f"In place of {choice}: change with --set KEY=VALUE, back with --from N"
            f"{'' if hold.refusal else ', or end'}.",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )

    def write_report(self) -> None:
        """Show that the report is written."""
        for task in self._tasks.values():
            self._finish(task)
        self._progress.update(self._report, visible=True, description="writing the report")
        self._progress.start_task(self._report)

    def _finish(self, task: int) -> None:
        self._progress.update(task, completed=1.0, remaining="")  # type: ignore[arg-type]

    def _errors(self, progress: RunProgress) -> str:
        table = progress.iterations
        if table is None or not len(table):
            return ""
        worst = float(table.judged_error[-1].max())
        of = f"/{self._iterations}" if self._iterations is not None else ""
        spent = passes(float(table.damage_spent()[-1][~table.watched].max()))
        return (
            f" · {table.numbers[-1]}{of} played, error {table.overall[-1]:.3f}, worst {worst:.3f}, most damage spent "
            f"{spent} passes of the target"
        )

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *raised: object) -> None:
        if raised[0] is None:
            self._progress.update(self._report, total=1.0, completed=1.0)
        self._progress.stop()


def remaining_words(seconds: float) -> str:
    """Return a remaining time as text, e.g. "2:05 left"; nothing where it is unknown."""
    if seconds < 0:
        return ""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d} left"


LARGEST_COLUMNS = 8
"""Playbacks in a table for the terminal."""
_LONGEST_WHOLE = 13
"""Characters of the longest heading that is not broken: `damage, k = 8`."""


def follow(
    output: Output,
    run: Callable[[Callable[[RunProgress], None]], CampaignResult],
    *,
    iterations: int | None,
    endpoint: str,
    on_fetched: Callable[[], None] = lambda: None,
) -> tuple[CampaignResult, Path]:
    """Run a campaign with a progress display, print its figures, and return it and its report.

    `on_fetched`: Called when the lab is no longer needed, before the report is written.
    """
    # What draws the report takes a second to import, and this process waits for the rig meanwhile.
    import_in_background("duralab.report.campaign_report")
    with RunDisplay(output.console, iterations=iterations, endpoint=endpoint) as display:
        result = run(display.show)
        on_fetched()
        display.write_report()
        with span("write the report", SpanKind.REPORT):
            report = result.report()
    print_result(output, result, report)
    return result, report


def conclude(output: Output, result: CampaignResult, report: Path) -> None:
    """Print the JSON document of a campaign if it is asked for; raises typer.Exit if the target was not reached."""
    output.document(campaign_document(result, report))
    if result.verdict.judgement is not Judgement.REACHED:
        raise typer.Exit(int(ExitCode.NOT_REACHED))


def print_result(output: Output, result: CampaignResult, report: Path) -> None:
    """Print the figures of a campaign, its verdict, and how to open what it left."""
    iterations = result.iterations
    title = "Relative RMS error after each playback (0 is perfect, ★ the best playback)"
    output.console.print(figure_table(title, result, iterations.relative_rms_error, overall=iterations.overall))
    title = "RMS response (1 is perfect)"
    output.console.print(figure_table(title, result, iterations.rms_response, overall=None))
    output.console.print(judged_table(result))
    output.console.print(damage_table(result))
    output.say(damage_note(iterations))
    style = "bold green" if result.verdict.judgement is Judgement.REACHED else "bold red"
    output.say(result.verdict.sentence, style=style)
    if repeats := repeatability_in_words(result.status):
        output.say(repeats)
    if result.status.remarks:
        output.console.print("\nNotes", style="bold")
    output.say(*(f"· {remark}" for remark in result.status.remarks))
    output.console.print()
    rows = (
        ("report", report, open_hint(report)),
        ("recording", result.recording_path, f'in Python, duralab.open("{result.recording_path}")'),
        ("live view", result.live_path, f"{own_command()} view {shlex.quote(str(result.live_path))}"),
    )
    # No table: a long path must be whole, so that it can be copied.
    output.say(*(f"{name:<10} {path}   open it:  {command}" for name, path, command in rows))


def judged_table(result: CampaignResult) -> Table:
    """Return the judged figures of the best playback for the terminal; those outside their limits are red."""
    iterations = result.iterations
    slope = counted_slope(result.specification)
    header, rows = judged_rows(iterations, result.verdict, slope=slope)
    title = f"Playback {iterations.numbers[iterations.best]}, the best, and what is allowed (✗ outside it)"
    table = Table(
        title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False
    )
    for column, (name, allowed) in enumerate(header):
        # On 80 columns the long names break, and the limits stay whole.
        whole = max((len(each) for each in (name, allowed) if len(each) <= _LONGEST_WHOLE), default=0)
        table.add_column(
            f"{name}\n[dim]{allowed}[/]",
            justify="right" if column else "left",
            no_wrap=not column,
            min_width=whole if 0 < column < len(header) - 1 else None,
        )
    for row in rows:
        table.add_row(*(f"[bold red]{cell}[/]" if cell.endswith("✗") else cell for cell in row))
    return table


def damage_table(result: CampaignResult) -> Table:
    """Return what the campaign cost the specimen for the terminal: a row for each channel, a column for each slope."""
    iterations = result.iterations
    table = Table(
        title="Damage spent in passes of the target: identification + playbacks",
        title_justify="left",
        title_style="bold",
        box=SIMPLE_HEAD,
    )
    table.add_column("channel", no_wrap=True)
    for slope in DAMAGE_SLOPES:
        table.add_column(f"k = {slope}", justify="right")
    spent = [iterations.damage_spent(slope) for slope in DAMAGE_SLOPES]
    for i, name in enumerate(iterations.channels):
        cells = (f"{passes(identified[i])} + {passes(played[i])}" for identified, played, _ in spent)
        table.add_row(name.replace("_", " "), *cells)
    return table


def figure_table(title: str, result: CampaignResult, values: np.ndarray, *, overall: np.ndarray | None) -> Table:
    """Return one kind of figure for the terminal: a row for each channel, a column for each playback."""
    iterations = result.iterations
    limit = result.verdict.limits.relative_rms_error if overall is not None else None
    shown = shown_playbacks(len(iterations), best=iterations.best)
    table = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD)
    table.add_column("playback")
    for row in shown:
        table.add_column(
            f"{iterations.numbers[row]}{'★' if row == iterations.best else ''}", justify="right", no_wrap=True
        )
    for i, name in enumerate(iterations.channels):
        watched = bool(iterations.watched[i])
        green = limit if not watched else None
        cells = [figure_cell(float(values[row, i]), green=green) for row in shown]
        table.add_row(name.replace("_", " ") + (" (monitored)" if watched else ""), *cells)
    if overall is not None:
        table.add_section()
        table.add_row("all channels", *(f"{overall[row]:.3f}" for row in shown))
    return table


def figure_cell(value: float, *, green: float | None) -> str:
    """Return a figure as the terminal shows it: green up to a limit, a dash where a watched channel has none."""
    if math.isnan(value):
        return "–"
    return f"[green]{value:.3f}[/green]" if green is not None and value <= green else f"{value:.3f}"


def shown_playbacks(count: int, *, best: int) -> list[int]:
    """Return which rows fit a terminal: all of a few playbacks, of more the first, the best and the last ones."""
    if count <= LARGEST_COLUMNS:
        return list(range(count))
    last = range(count - LARGEST_COLUMNS + 2, count)
    return sorted({0, best, *last})


def campaign_document(result: CampaignResult, report: Path) -> dict[str, object]:
    """Return what a campaign came to, for `--json`."""
    table, verdict = result.iterations, result.verdict
    slope = counted_slope(result.specification)
    return {
        "campaign": result.specification.id,
        "rig": result.specification.rig,
        "judgement": verdict.judgement.value,
        "verdict": verdict.sentence,
        "accept": asdict(verdict.limits),
        "not_accepted": [
            {"criterion": found.criterion.value, "channel": found.channel, "value": found.value}
            for found in verdict.failed
        ],
        **{name: getattr(table, name) for name in ("channels", "watched", "relative_rms_error", "rms_response")},
        **{name: getattr(table, name) for name in ("peak_ratio", "energy_outside_band")},
        "playbacks": table.numbers,
        "best_playback": table.numbers[table.best],
        "overall_error": table.overall,
        "damage_ratio": {str(k): table.damage_ratio[:, :, column] for column, k in enumerate(DAMAGE_SLOPES)},
        "damage_spent": {
            "damage_exponent": slope,
            "passes": table.damage_spent(slope)[-1],
            "counts_identification": table.counts_identification,
            "by_exponent": {
                str(k): dict(zip(("identification", "playbacks", "sum"), table.damage_spent(k), strict=True))
                for k in DAMAGE_SLOPES
            },
        },
        "remarks": list(result.status.remarks),
        "recording": result.recording_path,
        "live_view": result.live_path,
        "report": report,
    }
