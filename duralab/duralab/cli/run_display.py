"""What a run shows while it works: what it does now, how far it is, how long it will take, the error so far."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Final, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn

from duralab.lab import RunProgress, Stage

CAMPAIGN_STAGES: Final = (Stage.TARGET, Stage.CAMPAIGN)
"""What a run of a campaign works on, one after the other."""


class RunDisplay:
    """Progress bars of a run, one a stage; without a terminal one line for each new activity instead."""

    def __init__(
        self, console: Console, *, iterations: int | None = None, stages: Sequence[Stage] = CAMPAIGN_STAGES
    ) -> None:
        self._console = console
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
        if not self._console.is_terminal and text != self._last_line:
            self._last_line = text
            self._console.print(f"{progress.stage}: {text}", highlight=False, markup=False)

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
        return f" · {table.numbers[-1]}{of} played, error {table.overall[-1]:.3f}, worst {worst:.3f}"

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._progress.update(self._report, total=1.0, completed=1.0)
        self._progress.stop()


def remaining_words(seconds: float) -> str:
    """Return a remaining time in words, e.g. "2:05 left"; nothing where it is unknown."""
    if seconds < 0:
        return ""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d} left"
