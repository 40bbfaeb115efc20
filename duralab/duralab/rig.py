"""A rig as it describes itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from duralab.signals import Channel, channels_of
from duralab_proto.arrays import from_array
from duralab_proto.v1 import rig_pb2


@dataclass(frozen=True, eq=False)
class Rig:
    """What a rig is and what it can play.

    Parameters
    ----------
    name : str
        As in its keys.
    specimen, engine, version : str
        What is mounted on it, what plays, and the version of its software.
    sample_rate : float
        The only one it plays, in hertz.
    drives, responses : tuple of Channel
        What is commanded and what is measured, in the order of the rows of a drive and a response.
    longest_drive_seconds : float
        Longest drive it plays.
    static_response : np.ndarray, shape (responses)
        Each response at rest, in its unit.
    content_hash : str
        SHA-256 of everything that decides what it answers to a drive.
    publishes_after_run : bool
        Its signal blocks are published when a run is over.
    cannot_be_stopped : bool
        A run that has begun goes on to its end; a stop latches the rig all the same.
    """

    name: str
    specimen: str
    engine: str
    version: str
    sample_rate: float
    drives: tuple[Channel, ...]
    responses: tuple[Channel, ...]
    longest_drive_seconds: float
    static_response: np.ndarray
    content_hash: str
    publishes_after_run: bool = False
    cannot_be_stopped: bool = False

    @classmethod
    def from_message(cls, message: rig_pb2.RigDescription) -> Rig:
        """Decode a description."""
        return cls(
            name=message.rig,
            specimen=message.specimen,
            engine=message.engine,
            version=message.version,
            sample_rate=message.sample_rate,
            drives=channels_of(message.drives),
            responses=channels_of(message.responses),
            longest_drive_seconds=message.longest_drive_seconds,
            static_response=from_array(
                message.static_response, field="static_response", shape=(len(message.responses),)
            ),
            content_hash=message.content_hash,
            publishes_after_run=message.publishes_after_run,
            cannot_be_stopped=message.cannot_be_stopped,
        )

    def __repr__(self) -> str:
        """Return it on one line."""
        return f"Rig({self.name}: {len(self.drives)} drives, {len(self.responses)} responses, {self.sample_rate:g} Hz)"

    def __str__(self) -> str:
        """Return its channels and limits as a table."""
        from duralab.showing.values import rig_text

        return rig_text(self)

    def _repr_html_(self) -> str:
        from duralab.showing.values import rig_html

        return rig_html(self)


class Rigs(tuple[Rig, ...]):
    """Rigs of a lab, by name; prints as a table."""

    __slots__ = ()

    def __str__(self) -> str:
        """Return one line for each rig."""
        from duralab.showing.values import rigs_text

        return rigs_text(self)

    def _repr_html_(self) -> str:
        from duralab.showing.values import rigs_html

        return rigs_html(self)
