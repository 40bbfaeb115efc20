"""Campaigns or tests of one process: one at a time on each rig; of ended ones only the status is kept."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

from google.protobuf.message import Message

from duralab_bus.commanding.status_board import StatusBoard
from duralab_bus.faults import FaultError
from duralab_proto.v1 import query_pb2

WorkT = TypeVar("WorkT")
StatusT = TypeVar("StatusT", bound=Message)


def already_exists(id: str, *, field: str = "id") -> FaultError:
    """Return the fault for an id that has a recording.

    Parameters
    ----------
    id : str
        Id of the campaign or test.
    field : str
        Field of the request that holds it.

    Returns
    -------
    FaultError
        ALREADY_EXISTS, which is not raised here.
    """
    return FaultError(
        query_pb2.FAULT_CODE_ALREADY_EXISTS,
        f"A recording {id!r} exists already and is never overwritten; choose another id.",
        field=field,
    )


@dataclass(frozen=True)
class Admitted(Generic[WorkT, StatusT]):
    """A campaign or test of this process.

    Parameters
    ----------
    work : WorkT, optional
        The campaign or test; missing after its end.
    board : StatusBoard
        Its status.
    """

    work: WorkT | None
    board: StatusBoard[StatusT]


class Admissions(Generic[WorkT, StatusT]):
    """Campaigns or tests by id, and the rigs that they hold. Any thread may call.

    Parameters
    ----------
    what : str
        Kind of the work, e.g. "campaign".
    kept : int
        Largest number of ended ones whose status is kept.
    """

    def __init__(self, what: str, *, kept: int) -> None:
        self._what = what
        self._kept = kept
        self._lock = threading.Lock()
        self._admitted: dict[str, Admitted[WorkT, StatusT]] = {}
        # Kind and id of the work that holds each rig, from the checks to the end.
        self._holders: dict[str, tuple[str, str]] = {}

    @contextmanager
    def admitting(self, id: str, rig: str, *, what: str = "", again: bool = False) -> Iterator[None]:
        """Reserve id and rig for a work that is being checked; release them if the context ends with an error.

        `what`: Kind of the work if it is not the usual one. `again`: Whether an ended one with this id is resumed.
        Raises `FaultError`: ALREADY_EXISTS with the field `id`, BUSY with the field `rig`.
        """
        with self._lock:
            if (id in self._admitted and not again) or any(holder == id for _, holder in self._holders.values()):
                raise already_exists(id)
            if rig in self._holders:
                kind, holder = self._holders[rig]
                raise FaultError(
                    query_pb2.FAULT_CODE_BUSY,
                    f"Rig {rig!r} is in use by {kind} {holder!r}; wait for its end or stop it.",
                    field="rig",
                )
            self._holders[rig] = what or self._what, id
        try:
            yield
        except BaseException:
            self.release(rig)
            raise

    def release(self, rig: str) -> None:
        """Free a rig whose work has ended or did not begin."""
        with self._lock:
            del self._holders[rig]

    def begin(self, id: str, work: WorkT | None, board: StatusBoard[StatusT]) -> None:
        """Add an admitted work with its status; None for one that ended before this process began."""
        with self._lock:
            self._admitted[id] = Admitted(work, board)

    def end(self, id: str, rig: str) -> None:
        """Free the rig of a work, and drop everything of it except its status."""
        with self._lock:
            self._admitted[id] = Admitted(None, self._admitted[id].board)
            ended = [each for each, admitted in self._admitted.items() if admitted.work is None]
            for each in ended[: -self._kept]:
                del self._admitted[each]
        self.release(rig)

    def get(self, id: str) -> Admitted[WorkT, StatusT] | None:
        """Return the work of an id; None if this process knows none."""
        with self._lock:
            return self._admitted.get(id)

    def running(self) -> list[Admitted[WorkT, StatusT]]:
        """Return those that have not ended."""
        with self._lock:
            every = list(self._admitted.values())
        return [admitted for admitted in every if not admitted.board.ended]
