"""Catalogue of a lab's recordings: search, verify, fetch, and read parts of their signals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from numbers import Real
from pathlib import Path
from typing import Final

from duralab.arguments import require_text
from duralab.data import Signals
from duralab.display import html_table, text_table
from duralab.errors import InputError, NotReadyError
from duralab.lab.campaign_running import specification_of
from duralab.lab.client import LabClient, recordings_key
from duralab.lab.fetching import fetch_files
from duralab.lab.recorded_result import Result
from duralab_bus import FaultError
from duralab_proto.v1 import iterator_pb2, recorder_pb2

_CATALOGUE: Final = ("recording", "rig", "target", "begun", "result", "size")
_NO_RECORDING: Final = "There is no such recording."

_BEGINNING: Final = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND: Final = timedelta(microseconds=1)
_NANOSECONDS: Final = 1000
"""Nanoseconds in a microsecond, the resolution of a datetime."""
_FIRST_YEAR, _LAST_YEAR = 1970, 2553
"""Years between which the nanoseconds since the first fit 64 bits."""

_OUTCOMES: Final = {
    iterator_pb2.OUTCOME_REACHED: Result.REACHED,
    iterator_pb2.OUTCOME_ITERATIONS_USED: Result.ITERATIONS_USED,
    iterator_pb2.OUTCOME_DIVERGED: Result.DIVERGED,
    iterator_pb2.OUTCOME_NO_IMPROVEMENT: Result.NO_IMPROVEMENT,
    iterator_pb2.OUTCOME_DAMAGE_BUDGET_USED: Result.DAMAGE_BUDGET_USED,
    iterator_pb2.OUTCOME_RESPONSE_STOOD_STILL: Result.RESPONSE_STOOD_STILL,
    iterator_pb2.OUTCOME_BOUND_PASSED: Result.BOUND_PASSED,
    iterator_pb2.OUTCOME_ENDED_AT_HOLD_POINT: Result.ENDED_AT_HOLD_POINT,
}
_PRE_TESTS: Final = {
    iterator_pb2.PRE_TEST_VERDICT_PASSED: Result.PRE_TEST_PASSED,
    iterator_pb2.PRE_TEST_VERDICT_FAILED: Result.PRE_TEST_FAILED,
    iterator_pb2.PRE_TEST_VERDICT_UNFINISHED: Result.PRE_TEST_UNFINISHED,
}
_PHASES: Final = {
    iterator_pb2.CAMPAIGN_PHASE_FINISHED: Result.FINISHED,
    iterator_pb2.CAMPAIGN_PHASE_FAULTED: Result.FAULTED,
    iterator_pb2.CAMPAIGN_PHASE_STOPPED: Result.STOPPED,
}


@dataclass(frozen=True)
class CatalogueEntry:
    """Description of one recording of a lab.

    Parameters
    ----------
    id : str
        Name of the recording, which is the campaign's id.
    rig, target : str
        Rig and target of the campaign; empty if the recording is not of a campaign.
    begun : datetime or None
        Time at which the first step was stored, UTC, rounded down to a microsecond; None without steps.
    result : Result
        Result of the run.
    closed : bool
        Whether the recording is closed for writing; `result` shows whether the run reached its end.
    steps, signal_blocks, missing_blocks : int
        Numbers of steps, of signal blocks, and of blocks known to be missing.
    files : tuple of str
        Names of the files in the recorder's folder.
    bytes : int
        Size of all files.
    waiting : str
        Reason why the recording cannot be written now; empty if it can.
    """

    id: str
    rig: str
    target: str
    begun: datetime | None
    result: Result
    closed: bool
    steps: int
    signal_blocks: int
    missing_blocks: int
    files: tuple[str, ...]
    bytes: int
    waiting: str


class CatalogueEntries(tuple[CatalogueEntry, ...]):
    """Found recordings, the oldest first; prints as a table."""

    __slots__ = ()

    def __str__(self) -> str:
        """Return the entries as a table."""
        return text_table(_CATALOGUE, self._rows(), left=5) if self else _NO_RECORDING

    def _repr_html_(self) -> str:
        return html_table(_CATALOGUE, self._rows(), left=5) if self else f"<p>{_NO_RECORDING}</p>"

    def _rows(self) -> list[tuple[str, ...]]:
        return [
            (
                entry.id,
                entry.rig,
                entry.target,
                f"{entry.begun:%Y-%m-%d %H:%M} UTC" if entry.begun is not None else "–",
                entry.result if entry.closed else f"{entry.result}, not closed",
                f"{entry.bytes / 1e6:.1f} MB",
            )
            for entry in self
        ]


_SAME_NAMES: Final = ("rig", "target", "closed", "steps", "signal_blocks", "missing_blocks", "bytes", "waiting")


def _entry(information: recorder_pb2.RecordingInfo) -> CatalogueEntry:
    result = (
        _PRE_TESTS.get(information.pre_test)
        or _OUTCOMES.get(information.outcome)
        or _PHASES.get(information.phase, Result.NOT_ENDED)
    )
    return CatalogueEntry(
        id=information.recording,
        # Rounded down: a search from this time on finds the recording, and a search before it does not.
        begun=_BEGINNING + information.begun // _NANOSECONDS * _MICROSECOND if information.begun else None,
        result=result,
        files=tuple(file.file for file in information.files),
        **{name: getattr(information, name) for name in _SAME_NAMES},
    )


def _moment(given: object, *, field: str) -> datetime | None:
    """Convert a date or an ISO 8601 text to a datetime; a date without a time is its midnight."""
    moment = given
    if isinstance(given, str):
        try:
            moment = datetime.fromisoformat(given)
        except ValueError:
            moment = given
    elif isinstance(given, date) and not isinstance(given, datetime):
        moment = datetime(given.year, given.month, given.day)
    if moment is None or isinstance(moment, datetime):
        return moment
    raise InputError(
        f"{field} is {given!r}; give a datetime, a date or a text like 2026-05-04T12:00+02:00, or leave it out.",
        field=field,
    )


def _nanoseconds(given: object, *, field: str) -> int:
    moment = _moment(given, field=field)
    if moment is None:
        return 0
    # The year is checked first: near the first and last date of the calendar, conversion to UTC fails.
    in_range = _FIRST_YEAR <= moment.year <= _LAST_YEAR
    # In integers: as a float, the seconds would be off by up to half a microsecond.
    nanoseconds = (moment.astimezone(UTC) - _BEGINNING) // _MICROSECOND * _NANOSECONDS if in_range else 0
    if nanoseconds <= 0:
        raise InputError(
            f"{field} is {moment.isoformat()}; it must be after the beginning of {_FIRST_YEAR}, UTC, and no later than "
            f"{_LAST_YEAR}, or left out.",
            field=field,
        )
    return nanoseconds


def _result(given: object) -> Result | None:
    try:
        return None if given is None else Result(given)
    except ValueError:
        raise InputError(
            f"result is {given!r}; give one of {', '.join(Result)}, or leave it out.", field="result"
        ) from None


def _number(given: object, *, field: str) -> float:
    if isinstance(given, bool) or not isinstance(given, Real):
        raise InputError(f"{field} is {given!r}; give a number of seconds.", field=field)
    return float(given)


def _channel_names(given: object) -> list[str]:
    # A string is a sequence of strings too: its letters.
    if isinstance(given, Iterable) and not isinstance(given, str):
        names = list(given)
        if all(isinstance(name, str) for name in names):
            return names
    raise InputError(
        f"channels is {given!r}; give a sequence of names, e.g. ['left_vertical'], or leave it out.", field="channels"
    )


class Catalogue:
    """Recordings of a lab's recorder; made by `Lab.catalogue`."""

    def __init__(self, ask: LabClient) -> None:
        self._ask = ask

    def search(
        self,
        *,
        rig: str = "",
        target: str = "",
        begun_from: datetime | date | str | None = None,
        begun_before: datetime | date | str | None = None,
        result: Result | str | None = None,
    ) -> CatalogueEntries:
        """Return the recordings that match, the oldest first.

        Parameters
        ----------
        rig : str
            Rig of the recordings; any if empty.
        target : str
            Part of the target's source, in any case; any if empty.
        begun_from, begun_before : datetime, date or str, optional
            Earliest begin, and the time before which the recordings began, from 1970 to 2553. Without a time zone it is
            local time; a date without a time is its midnight; a text is in ISO 8601, e.g. 2026-05-04.
        result : Result or str, optional
            Result of the recordings, or its text, e.g. "iterations used"; any if None.

        Returns
        -------
        CatalogueEntries
            Sequence of the recordings; prints as a table.

        Raises
        ------
        InputError
            `begun_from` or `begun_before` is outside those years, or a value has another type.
        """
        ended = _result(result)
        require_text(rig, field="rig")
        require_text(target, field="target")
        request = recorder_pb2.ListRecordingsRequest(
            rig=rig,
            target=target,
            begun_from=_nanoseconds(begun_from, field="begun_from"),
            begun_before=_nanoseconds(begun_before, field="begun_before"),
        )
        answer = self._ask.query(recordings_key(self._ask.bus), request, recorder_pb2.RecordingList)
        entries = [_entry(information) for information in answer.recordings]
        wanted = [entry for entry in entries if ended is None or entry.result is ended]
        return CatalogueEntries(sorted(wanted, key=lambda entry: (entry.begun is None, entry.begun, entry.id)))

    def verify(self, id: str) -> list[str]:
        """Check a whole recording; return a sentence for each defect.

        Parameters
        ----------
        id : str
            The recording; it is not written any more.

        Returns
        -------
        list of str
            Empty if the recording has no defect.

        Raises
        ------
        InputError
            There is no such recording.
        LabError
            The recording is still written.
        """
        key = self._ask.key("id", self._ask.bus.keys.recording_verify, id)
        answer = self._ask.query(key, recorder_pb2.VerifyRecordingRequest(), recorder_pb2.VerifyResult)
        return list(answer.findings)

    def target(self, id: str) -> Signals:
        """Return the target that a campaign reproduces, also while it runs.

        Parameters
        ----------
        id : str
            The campaign.

        Returns
        -------
        Signals
            Target as the iterator received it: all responses of the rig.

        Raises
        ------
        LabError
            There is no such recording, or it is not of a campaign.
        """
        specification = specification_of(self._ask, id)
        return Signals.from_message(specification.target, field="target")

    def fetch(self, id: str, folder: Path) -> Path:
        """Copy the files of a recording to a folder.

        Parameters
        ----------
        id : str
            The recording; it is not written any more.
        folder : Path
            Output folder; created if missing.

        Returns
        -------
        Path
            Path of `recording.mcap`; its parts and `live.rrd` are beside it.

        Raises
        ------
        LabError
            There is no such recording, it is still written, or it does not arrive complete.
        """
        information = self._ask.query(
            self._ask.key("id", self._ask.bus.keys.recording, id),
            recorder_pb2.RecordingRequest(),
            recorder_pb2.RecordingInfo,
        )
        if not information.closed:
            raise NotReadyError(f"The recording {id!r} is still written; ask again when it is closed.", field="id")
        folder.mkdir(parents=True, exist_ok=True)
        try:
            return fetch_files(self._ask.bus, information, folder=folder)[0]
        except FaultError as fault:
            raise self._ask.explained(fault) from fault

    def signals(
        self, id: str, run: str, *, first_second: float, seconds: float, channels: Sequence[str] = ()
    ) -> tuple[Signals, Signals]:
        """Read a part of the drives and responses; only that part is read from the disk and sent.

        Parameters
        ----------
        id : str
            The recording; it is not written any more.
        run : str
            The run on the rig, e.g. demo.i03.
        first_second, seconds : float
            Start of the part since the run's start, 0 or more, and its length, greater than 0, in seconds.
        channels : sequence of str
            Names of drives and responses; all if empty.

        Returns
        -------
        drive, response : Signals
            Signals of the part; shorter than requested if the run ended before.

        Raises
        ------
        InputError
            There is no such recording, run, time or channel, or a value has another type.
        """
        require_text(run, field="run")
        key = self._ask.key("id", self._ask.bus.keys.recording_signals, id)
        request = recorder_pb2.SignalWindowRequest(
            run=run,
            first_second=_number(first_second, field="first_second"),
            seconds=_number(seconds, field="seconds"),
            channels=_channel_names(channels),
        )
        answer = self._ask.query(key, request, recorder_pb2.SignalWindow)
        return (
            Signals.from_message(answer.drive, field="drive"),
            Signals.from_message(answer.response, field="response"),
        )
