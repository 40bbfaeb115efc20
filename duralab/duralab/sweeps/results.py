"""Results of a sweep: a row for each ended point, and two Parquet files of all points."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from duralab.errors import InputError
from duralab.lab import CampaignResult
from duralab.output_files import replace_when_complete
from duralab.sweeps.sweep_file import Objective, Sweep

OUTCOME: Final = "outcome.parquet"
"""Name of a point's outcome file in its folder; written last, so that the point is complete if it exists."""


class State(StrEnum):
    """Outcome of a point."""

    FINISHED = "finished"
    FAILED = "failed"


@dataclass(frozen=True)
class Costs:
    """Times of a point in seconds: for its cell, for its campaign, and processor time of the worker's process."""

    cell: float = 0.0
    campaign: float = 0.0
    processor: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """Row of a point, with the best playback of its campaign; numbers are empty if it failed.

    `sentence`: Verdict, or reason of the failure. `overall_error`, `worst_error`: Relative RMS error of the best
    playback over all judged channels, and the largest of a channel. `errors`, `rms_responses`, `overall`: A row or
    number for each playback. `rig_hash`: SHA-256 of all settings that determine the rig's responses. `bytes`: Size of
    the kept recording.
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
        """Return the error by which points are compared; None if the point failed."""
        return self.overall_error if objective is Objective.OVERALL_ERROR else self.worst_error


def outcome_of(id: str, result: CampaignResult, *, rig_hash: str, worker: str, costs: Costs, bytes: int) -> Outcome:
    """Return the row of a finished campaign."""
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
    """Return the row of a point, None if it has not ended; raises InputError if it cannot be read."""
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
    """Return the columns of an outcome: its fields, with the costs as a struct."""
    import pyarrow as arrow

    kinds = {"str": arrow.string(), "State": arrow.string(), "bool": arrow.bool_(), "int": arrow.int64()}
    kinds |= {"float": arrow.float64(), "Costs": arrow.struct([(part.name, arrow.float64()) for part in fields(Costs)])}

    def column(kind: str) -> Any:
        inner = kind.removeprefix("Sequence[").removesuffix("]") if kind.startswith("Sequence[") else None
        return kinds[kind.removesuffix(" | None")] if inner is None else arrow.list_(column(inner))

    return arrow.schema([(one.name, column(str(one.type))) for one in fields(Outcome)])


RESULTS: Final = "results.parquet"
"""Name of the file with a row for each point."""

PLAYBACKS: Final = "playbacks.parquet"
"""Name of the file with a row for each response of each playback."""

POINTS: Final = "points"
"""Name of the folder with a folder for each point, named by its id."""

_ABOUT: Final = b"duralab"
_NESTED: Final = ("channels", "watched", "numbers", "errors", "rms_responses", "overall", "costs")


@dataclass(frozen=True)
class SweepResults:
    """Results of a sweep, with the text of its file.

    `keys`: Dotted keys that differ between points. `total`: Number of points, equal to the number of rows at the end.
    `rows`: A row for each ended point: its settings by dotted key, and the fields of its outcome.
    """

    folder: Path
    name: str
    text: str
    keys: tuple[str, ...]
    total: int
    objective: Objective
    rows: tuple[Mapping[str, Any], ...]

    @property
    def finished(self) -> tuple[Mapping[str, Any], ...]:
        """Rows of finished campaigns."""
        return tuple(row for row in self.rows if row["state"] == State.FINISHED)

    @property
    def failed(self) -> tuple[Mapping[str, Any], ...]:
        """Rows of failed campaigns, with their sentences."""
        return tuple(row for row in self.rows if row["state"] == State.FAILED)

    @property
    def best(self) -> Mapping[str, Any] | None:
        """Row with the smallest compared error; None if no campaign finished."""
        return min(self.finished, key=lambda row: row[self.objective.value], default=None)


def write_results(
    folder: Path, sweep: Sweep, rows: Sequence[tuple[Mapping[str, Any], Outcome]], *, total: int
) -> SweepResults:
    """Write `results.parquet` and `playbacks.parquet`, and return their content."""
    import pyarrow
    from pyarrow import parquet

    keys = tuple(dict.fromkeys(key for settings, _ in rows for key in settings))
    points = _even([_point(settings, outcome) for settings, outcome in rows])
    about = {"name": sweep.name, "text": sweep.text, "keys": keys, "total": total, "objective": sweep.compare_by.value}
    playbacks = [line for _, outcome in rows for line in _playbacks(outcome)]
    for name, table in (
        (RESULTS, pyarrow.Table.from_pylist(points)),
        (PLAYBACKS, pyarrow.Table.from_pylist(playbacks)),
    ):
        with replace_when_complete(folder / name) as temporary:
            parquet.write_table(table.replace_schema_metadata({_ABOUT: json.dumps(about)}), temporary)
    return SweepResults(folder, sweep.name, sweep.text, keys, total, sweep.compare_by, tuple(points))


def read_results(folder: str | Path) -> SweepResults:
    """Read the results of a sweep."""
    import pyarrow
    from pyarrow import parquet

    path = Path(folder) / RESULTS
    if not path.is_file():
        raise InputError(f"{folder} holds no {RESULTS}; give the folder of a sweep, e.g. out/sweeps/<name>.")
    try:
        table = parquet.read_table(path)
        about = json.loads((table.schema.metadata or {})[_ABOUT])
        keys, total, objective = tuple(about["keys"]), int(about["total"]), Objective(about["objective"])
        rows = tuple(table.to_pylist())
    except (OSError, pyarrow.ArrowException, KeyError, ValueError) as error:
        reason = (
            "its metadata name no sweep" if isinstance(error, KeyError) else " ".join(str(error).split()).rstrip(".")
        )
        raise InputError(
            f"{path} is not the result of a sweep ({reason}); give the folder of a sweep, e.g. out/sweeps/<name>."
        ) from error
    return SweepResults(Path(folder), about["name"], about["text"], keys, total, objective, rows)


def plain(value: Any) -> bool | int | float | str | None:
    """Return a setting as a cell of a table: unchanged, or as JSON if it has parts."""
    return value if value is None or isinstance(value, bool | int | float | str) else json.dumps(value)


def _point(settings: Mapping[str, Any], outcome: Outcome) -> dict[str, Any]:
    row = {key: plain(value) for key, value in settings.items()}
    # Not `asdict`, which copies the figures of all playbacks: it took three quarters of the time of writing.
    row |= {field.name: plain(getattr(outcome, field.name)) for field in fields(outcome) if field.name not in _NESTED}
    return row | {f"seconds_{field.name}": getattr(outcome.costs, field.name) for field in fields(outcome.costs)}


def _playbacks(outcome: Outcome) -> list[dict[str, Any]]:
    lines = []
    for row, number in enumerate(outcome.numbers):
        figures = zip(outcome.channels, outcome.watched, outcome.errors[row], outcome.rms_responses[row], strict=True)
        for channel, watched, error, response in figures:
            lines.append(
                {
                    "id": outcome.id,
                    "playback": number,
                    "channel": channel,
                    "watched": watched,
                    "relative_rms_error": error,
                    "rms_response": response,
                    "overall_error": outcome.overall[row],
                }
            )
    return lines


def _even(points: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Give every column one type: mixed integers and floats become floats, any other mixture becomes JSON."""
    for key in dict.fromkeys(key for point in points for key in point):
        kinds = {type(point.get(key)) for point in points} - {type(None)}
        if kinds == {int, float}:
            for point in points:
                point[key] = None if point.get(key) is None else float(point[key])
        elif len(kinds) > 1 and not all(issubclass(kind, str) for kind in kinds):
            for point in points:
                point[key] = json.dumps(point.get(key))
    return points
