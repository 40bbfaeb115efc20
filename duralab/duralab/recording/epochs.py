"""Which of the epochs of a run counts: one that was repeated after a fault has several."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from duralab_proto.v1 import recorder_pb2


def played_epochs(told: Iterable[recorder_pb2.RunPlayed]) -> dict[str, int]:
    """Return the epoch in which each run was played to its end, by run.

    Parameters
    ----------
    told : iterable of RunPlayed
        What was committed after playbacks, in order: the last of a run counts.
    """
    return {played.run: played.epoch for played in told}


def counting_epoch(written: Sequence[int], *, played: int) -> int:
    """Return the epoch that was played to its end, or where none was the one that was written last.

    The numbers do not tell: they come from a clock, which may have been set back.

    Parameters
    ----------
    written : sequence of int
        Epoch of each of the run's blocks, or groups of them, in the order they were written; one or more.
    played : int
        What `played_epochs` says of the run; 0 where it says nothing.
    """
    return played or written[-1]
