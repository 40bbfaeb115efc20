"""Playback of drives on the campaign's rig: announced in its recording, requested once, its response checked."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import numpy as np
import structlog
from numpy.typing import NDArray

from duralab_bus import Bus, RecordingLog
from duralab_proto.arrays import to_record
from duralab_proto.v1 import query_pb2, recorder_pb2, rig_pb2
from iterator.campaign import seeds
from iterator.campaign.messages import checked_response
from iterator.campaign.plan import CampaignPlan
from iterator.campaign.resumption import run_name

LONGEST_WORDS: Final = 300
"""Longest text of a rig that is shown; it is part of every status."""

_PLAYING: Final = "playing"


def words_of(progress: query_pb2.Progress, *, run: str) -> str:
    """Return the present activity of a rig or the identifier in one line."""
    said = [text for text in (progress.phase, progress.detail) if text not in ("", _PLAYING, run)]
    # Untrusted text goes to terminals, tables and logs: no line breaks, no control characters.
    printable = "".join(letter if letter.isprintable() else " " for letter in ", ".join(said))
    words = " ".join(printable.split())
    return words if len(words) <= LONGEST_WORDS else f"{words[:LONGEST_WORDS]}…"


class RigPlayback:
    """Playbacks on the rig of one campaign; used by the campaign's thread.

    `plan`: Plan with the rig and its channels. `bus`: Bus of the rig. `log`: Log that announces every motion.
    `planned`: Runs that were announced before this process. `cancel`: Event that interrupts a playback.
    """

    def __init__(
        self,
        plan: CampaignPlan,
        *,
        bus: Bus,
        log: RecordingLog,
        planned: tuple[str, ...],
        cancel: threading.Event,
    ) -> None:
        self._plan = plan
        self._bus = bus
        self._log = log
        self._planned = planned
        self._cancel = cancel
        self._moving_run = ""
        self._played = rig_pb2.PlayResult()

    @property
    def moving_run(self) -> str:
        """Run that the rig may be playing; empty if the rig is known to be at rest."""
        return self._moving_run

    @property
    def played(self) -> rig_pb2.PlayResult:
        """Last response of the rig."""
        return self._played

    def announce(self, stem: str, *, purpose: str) -> str:
        """Store the announcement of a motion before it is requested."""
        run = run_name(stem, self._planned)
        if run != stem:
            structlog.get_logger("iterator").warning(
                "A motion that was not acknowledged before the crash is asked for again.", run=run
            )
        self._log.commit(recorder_pb2.RunPlanned(run=run, rig=self._plan.spec.rig, purpose=purpose))
        return run

    @contextmanager
    def motion(self, run: str) -> Iterator[None]:
        """Keep the name of a run that the rig may play, also if the enclosed block fails."""
        self._moving_run = run
        yield
        self._moving_run = ""

    def play(
        self,
        drive: NDArray[np.float64],
        *,
        stem: str,
        purpose: str,
        seed_index: int,
        on_progress: Callable[[query_pb2.Progress], None],
    ) -> NDArray[np.float64]:
        """Play a drive once."""
        description = self._plan.description
        run = self.announce(stem, purpose=purpose)
        with self.motion(run):
            self._played = self._bus.query(
                self._bus.keys.rig_play(self._plan.spec.rig),
                rig_pb2.PlayRequest(
                    run=run,
                    drive=to_record(description.drives, description.sample_rate, drive),
                    seed=seeds.derived_seed(self._plan.spec.seed, seed_index),
                    real_time=self._plan.spec.real_time,
                ),
                rig_pb2.PlayResult,
                on_progress=on_progress,
                cancel=self._cancel,
            )
        return checked_response(self._played, run=run, samples=drive.shape[1], plan=self._plan)
