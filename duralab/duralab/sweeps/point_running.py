"""Points on their way through the workers: those that have ended are not run again, one that fails stops no other."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from duralab.errors import LabError
from duralab.sweeps.campaign_task import Task, run_point
from duralab.sweeps.cluster import thread_counts
from duralab.sweeps.outcome import Outcome, State, read_outcome, write_outcome
from duralab.sweeps.points import Point
from duralab.sweeps.results import POINTS
from duralab.sweeps.sweep_file import Sweep

if TYPE_CHECKING:
    from distributed import Client

AHEAD = 2
"""Tasks for each worker that are with the scheduler: one that runs, one that follows it at once."""

RETRIES = 1
"""How often a campaign is run again whose worker died; the second time, the campaign is why."""


class PointRunner:
    """Runs points on the workers of a client.

    `open_client`: Starts or finds the workers; called when there is something to run, and not before. `sweep`: What
    they run in, and what is kept. `folder`: Of the sweep, as every worker sees it. `retry_failed`: Whether points that
    failed before are run again.
    """

    def __init__(self, open_client: Callable[[], Client], sweep: Sweep, *, folder: Path, retry_failed: bool) -> None:
        self._open_client = open_client
        self._sweep = sweep
        self._points = folder.resolve() / POINTS
        self._retry_failed = retry_failed

    @cached_property
    def _client(self) -> Client:
        return self._open_client()

    def run(self, points: Sequence[Point]) -> Generator[tuple[Point, Outcome]]:
        """Yield every point with what became of it: first those that have ended, the others as they end."""
        waiting: deque[Point] = deque()
        twins: dict[str, list[Point]] = {}
        for point in points:
            ended = self._ended(point)
            if ended is not None:
                yield point, ended
            elif point.id in twins:
                # The same campaign under other settings, e.g. a gain that a schedule makes equal: once is enough.
                twins[point.id].append(point)
            else:
                twins[point.id] = [point]
                waiting.append(point)
        for point, outcome in self._outcomes(waiting) if waiting else ():
            for twin in twins[point.id]:
                yield twin, outcome

    def _ended(self, point: Point) -> Outcome | None:
        outcome = read_outcome(self._points / point.id)
        return None if outcome is not None and outcome.state is State.FAILED and self._retry_failed else outcome

    def _outcomes(self, waiting: deque[Point]) -> Generator[tuple[Point, Outcome]]:
        from distributed import as_completed

        client = self._client
        running: dict[Any, Point] = {}
        completed = as_completed(loop=client.loop)

        def submit() -> None:
            point = waiting.popleft()
            task = Task(point, self._points / point.id, self._sweep.cell, self._sweep.keep)
            # The key holds more than the id: a point that is retried is a task of its own.
            future = client.submit(run_point, task, pure=False, retries=RETRIES)
            running[future] = point
            completed.add(future)

        while waiting and len(running) < AHEAD * len(thread_counts(client)):
            submit()
        try:
            for future in completed:
                point = running.pop(future)
                outcome = self._outcome(point, future)
                if waiting:
                    submit()
                yield point, outcome
        finally:
            client.cancel(list(running))

    def _outcome(self, point: Point, future: Any) -> Outcome:
        if future.cancelled():
            raise LabError("The scheduler gave up the campaigns; see its log, and run the sweep again to go on.")
        error = future.exception()
        if error is None:
            return future.result()
        told = " ".join(str(error).split()) or type(error).__name__
        sentence = f"The worker could not bring the campaign to its end: {told.rstrip('.')}."
        outcome = Outcome(point.id, State.FAILED, sentence)
        write_outcome(outcome, self._points / point.id)
        return outcome
