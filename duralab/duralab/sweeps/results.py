"""The results of a sweep: two Parquet files that any tool reads, and the report's source."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from duralab.errors import InputError
from duralab.output_files import replace_when_complete
from duralab.sweeps.outcome import Outcome, State
from duralab.sweeps.sweep_file import Objective, Sweep

RESULTS: Final = "results.parquet"
"""Of a sweep: a row for each point."""

PLAYBACKS: Final = "playbacks.parquet"
"""Of a sweep: a row for each response of each playback."""

POINTS: Final = "points"
"""Of a sweep: a folder for each point, named by its id."""

_ABOUT: Final = b"duralab"
_NESTED: Final = ("channels", "watched", "numbers", "errors", "rms_responses", "overall", "costs")


@dataclass(frozen=True)
class SweepResults:
    """What a sweep came to.

    `folder`: Of the sweep. `name`: Of the sweep. `text`: Its file, word for word. `keys`: What differs from point to
    point, by dotted key. `total`: Points it has; as many rows where all have ended. `objective`: The figure to compare
    by. `rows`: A row for each point that has ended: its settings by dotted key, and the fields of its outcome.
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
        """The rows whose campaigns came to their end."""
        return tuple(row for row in self.rows if row["state"] == State.FINISHED)

    @property
    def failed(self) -> tuple[Mapping[str, Any], ...]:
        """The rows whose campaigns failed, with their sentences."""
        return tuple(row for row in self.rows if row["state"] == State.FAILED)

    @property
    def best(self) -> Mapping[str, Any] | None:
        """The row with the smallest figure; None where no campaign came to its end."""
        return min(self.finished, key=lambda row: row[self.objective.value], default=None)


def write_results(
    folder: Path, sweep: Sweep, rows: Sequence[tuple[Mapping[str, Any], Outcome]], *, total: int
) -> SweepResults:
    """Write `results.parquet` and `playbacks.parquet`, and return what stands in them."""
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
    """Read the results of a sweep.

    `folder`: Folder of the sweep.
    Returns: The results of its points.
    Raises `InputError`: There are none in the folder, or they are no sweep's.
    """
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
        raise InputError(f"{path} is not the result of a sweep ({error}).") from error
    return SweepResults(Path(folder), about["name"], about["text"], keys, total, objective, rows)


def plain(value: Any) -> bool | int | float | str | None:
    """Return a setting as a cell of a table: as it is, or as JSON where it has parts."""
    return value if value is None or isinstance(value, bool | int | float | str) else json.dumps(value)


def _point(settings: Mapping[str, Any], outcome: Outcome) -> dict[str, Any]:
    fields = asdict(outcome)
    row = {key: plain(value) for key, value in settings.items()}
    row |= {name: plain(value) for name, value in fields.items() if name not in _NESTED}
    return row | {f"seconds_{name}": seconds for name, seconds in fields["costs"].items()}


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
    """Make every column of one kind: whole numbers among others become floating, any other mixture becomes JSON."""
    for key in dict.fromkeys(key for point in points for key in point):
        kinds = {type(point.get(key)) for point in points} - {type(None)}
        if kinds == {int, float}:
            for point in points:
                point[key] = None if point.get(key) is None else float(point[key])
        elif len(kinds) > 1 and not all(issubclass(kind, str) for kind in kinds):
            for point in points:
                point[key] = json.dumps(point.get(key))
    return points
