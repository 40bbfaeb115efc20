"""What became of a point: one row of the results, kept in a Parquet file of its own as soon as it is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from duralab.errors import InputError
from duralab.lab import CampaignResult
from duralab.output_files import replace_when_complete
from duralab.sweeps.sweep_file import Objective

OUTCOME: Final = "outcome.parquet"
"""Of a point, in its folder; written last, so that whoever sees it sees all of the point."""


class State(StrEnum):
    """How a point ended."""

    FINISHED = "finished"
    FAILED = "failed"


@dataclass(frozen=True)
class Costs:
    """Where the time of a point went, in seconds.

    `cell`: Opening a rig cell; next to nothing where one was there. `campaign`: Target, identification, playbacks and
    updates, and bringing the recording to its place. `processor`: Processor time of the worker's process in all; that
    of a lab's processes is not in it.
    """

    cell: float = 0.0
    campaign: float = 0.0
    processor: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """The row of a point; figures are empty where it failed.

    `id`: Of the point. `state`: Whether its campaign came to its end. `sentence`: Its verdict, or why it failed.
    `judgement`: How it ended, seen from what was wanted; empty where it failed. `best_playback`: Number of the playback
    with the smallest error; 0 where there is none. `overall_error`, `worst_error`: Relative RMS error of that playback
    over all judged channels, and the largest of a channel. `channels`: The responses. `watched`: Which of them are not
    judged. `numbers`: Of the playbacks. `errors`, `rms_responses`: Relative RMS error and RMS response, a row for each
    playback. `overall`: Relative RMS error over all judged channels after each playback. `rig_hash`: SHA-256 of all
    that decides what the rig answers. `worker`: Where it ran. `costs`: Where the time went. `bytes`: Size of the
    recording that is kept.
    """

    id: str
    state: State
    sentence: str
    judgement: str = ""
    best_playback: int = 0
    overall_error: float | None = None
    worst_error: float | None = None
    channels: Sequence[str] = ()
    watched: Sequence[bool] = ()
    numbers: Sequence[int] = ()
    errors: Sequence[Sequence[float]] = ()
    rms_responses: Sequence[Sequence[float]] = ()
    overall: Sequence[float] = ()
    rig_hash: str = ""
    worker: str = ""
    costs: Costs = field(default_factory=Costs)
    bytes: int = 0

    def objective(self, objective: Objective) -> float | None:
        """Return the figure that points are compared by; None where it failed."""
        return self.overall_error if objective is Objective.OVERALL_ERROR else self.worst_error


def outcome_of(id: str, result: CampaignResult, *, rig_hash: str, worker: str, costs: Costs, bytes: int) -> Outcome:
    """Return the row of a campaign that came to its end."""
    table, verdict = result.iterations, result.verdict
    best = table.best
    return Outcome(
        id=id,
        state=State.FINISHED,
        sentence=verdict.sentence,
        judgement=verdict.judgement.value,
        best_playback=table.numbers[best],
        overall_error=float(table.overall[best]),
        worst_error=float(table.judged_error[best].max()),
        channels=table.channels,
        watched=[bool(watched) for watched in table.watched],
        numbers=table.numbers,
        errors=table.relative_rms_error.tolist(),
        rms_responses=table.rms_response.tolist(),
        overall=table.overall.tolist(),
        rig_hash=rig_hash,
        worker=worker,
        costs=costs,
        bytes=bytes,
    )


def write_outcome(outcome: Outcome, folder: Path) -> None:
    """Write the row of a point into its folder."""
    import pyarrow
    from pyarrow import parquet

    table = pyarrow.Table.from_pylist([asdict(outcome)], schema=_schema())
    with replace_when_complete(folder / OUTCOME) as temporary:
        parquet.write_table(table, temporary)


def read_outcome(folder: Path) -> Outcome | None:
    """Return the row of a point, None where it has not ended; raises InputError where it cannot be read."""
    import pyarrow
    from pyarrow import parquet

    path = folder / OUTCOME
    if not path.is_file():
        return None
    try:
        row = parquet.read_table(path, schema=_schema()).to_pylist()[0]
    except (OSError, pyarrow.ArrowException, IndexError) as error:
        raise InputError(
            f"{path} is not the outcome of a point ({error}); remove it, and the point is run again."
        ) from error
    return Outcome(**{**row, "state": State(row["state"]), "costs": Costs(**row["costs"])})


def _schema() -> Any:
    import pyarrow as arrow

    floats, rows = arrow.list_(arrow.float64()), arrow.list_(arrow.list_(arrow.float64()))
    costs = arrow.struct([(name, arrow.float64()) for name in ("cell", "campaign", "processor")])
    return arrow.schema(
        [
            *((name, arrow.string()) for name in ("id", "state", "sentence", "judgement")),
            ("best_playback", arrow.int64()),
            ("overall_error", arrow.float64()),
            ("worst_error", arrow.float64()),
            ("channels", arrow.list_(arrow.string())),
            ("watched", arrow.list_(arrow.bool_())),
            ("numbers", arrow.list_(arrow.int64())),
            ("errors", rows),
            ("rms_responses", rows),
            ("overall", floats),
            ("rig_hash", arrow.string()),
            ("worker", arrow.string()),
            ("costs", costs),
            ("bytes", arrow.int64()),
        ]
    )
