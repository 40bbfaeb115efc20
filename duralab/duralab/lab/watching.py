"""Live view of a lab as one iterator: signals and states of rigs, progress of campaigns and endurance tests."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, Self

from duralab.data import Rig, RigState, Signals
from duralab.errors import LabTimeoutError
from duralab.lab.client import LabClient, deadline_of
from duralab.lab.endurance import EnduranceProgress
from duralab.lab.progress import ENDED, POLL_SECONDS, RunProgress, progress_of
from duralab_bus import StreamItem
from duralab_proto.arrays import from_array
from duralab_proto.keys import ANY, rig_of
from duralab_proto.v1 import iterator_pb2, rig_pb2, sequencer_pb2

MOST_WAITING: Final = 4096
"""Maximum number of events that wait for a slow script; beyond it the oldest are dropped and counted."""


class Watched(StrEnum):
    """Kind of a watched source."""

    SIGNALS = "signals"
    RIG_STATES = "rig states"
    CAMPAIGNS = "campaigns"
    ENDURANCE_TESTS = "endurance tests"


@dataclass(frozen=True, eq=False)
class SignalsEvent:
    """Block of the signals that a rig plays, of at most `block_samples` samples.

    Parameters
    ----------
    rig, run : str
        Names of the rig and of its run.
    first_sample : int
        Index of the first sample within the run; larger than expected if a block was lost.
    drive, response : Signals
        Commanded and measured signals.
    last : bool
        Whether this is the last block of the run.
    """

    rig: str
    run: str
    first_sample: int
    drive: Signals
    response: Signals
    last: bool


@dataclass(frozen=True)
class RigEvent:
    """Change of a rig's state, or its progress.

    Parameters
    ----------
    state : RigState
        State of the rig, with its name.
    """

    state: RigState


@dataclass(frozen=True)
class CampaignEvent:
    """Progress of a campaign, or its sign of life.

    Parameters
    ----------
    id : str
        Id of the campaign.
    progress : RunProgress
        Progress of the campaign.
    ended : bool
        Whether the campaign has ended.
    """

    id: str
    progress: RunProgress
    ended: bool


@dataclass(frozen=True)
class EnduranceEvent:
    """Progress of an endurance test, or its sign of life.

    Parameters
    ----------
    progress : EnduranceProgress
        Progress, with the test's name and rig.
    """

    progress: EnduranceProgress


LabEvent = SignalsEvent | RigEvent | CampaignEvent | EnduranceEvent


class Watch(Iterator[LabEvent]):
    """Live events of a lab; made by `Lab.watch`. Listens until `close`, or the end of `with`.

    Events lost by a broken link are not fetched again; the recording has them. A script that is slower than the lab
    gets the newest events, and `dropped` is the number of those it did not get.
    """

    def __init__(
        self,
        ask: LabClient,
        *,
        describe: Callable[[str], Rig],
        rig: str,
        campaign: str,
        kinds: frozenset[Watched],
        timeout_seconds: float | None,
    ) -> None:
        deadline_of(timeout_seconds, None)  # a wrong time is an error here, not at the first event
        self.dropped = 0
        self._ask, self._describe, self._campaign = ask, describe, campaign
        self._silence_seconds = math.inf if timeout_seconds is None else timeout_seconds
        self._rigs: dict[str, Rig] = {}
        self._waiting: deque[StreamItem[Any] | iterator_pb2.CampaignStatus] = deque()
        self._changed = threading.Condition()
        self._closed = False
        keys, listen = ask.bus.keys, ask.bus.subscribe
        with ExitStack() as stack:
            if Watched.SIGNALS in kinds:
                key = ask.key("rig", lambda name: keys.rig_signal(name, ANY), rig)
                stack.callback(listen(key, rig_pb2.SignalBlock, self._put).close)
            if Watched.RIG_STATES in kinds:
                stack.callback(listen(ask.key("rig", keys.rig_state, rig), rig_pb2.RigState, self._put).close)
            if Watched.CAMPAIGNS in kinds:
                key = ask.key("campaign", keys.campaign_event, campaign)
                stack.callback(listen(key, iterator_pb2.CampaignEvent, self._put).close)
                if campaign != ANY:
                    self._put(self._asked())
            # A campaign was chosen, so endurance tests are not watched.
            if Watched.ENDURANCE_TESTS in kinds and campaign == ANY:
                stack.callback(listen(keys.endurance_event(ANY), sequencer_pb2.EnduranceEvent, self._put).close)
            self._subscriptions = stack.pop_all()
        self._polls = Watched.CAMPAIGNS in kinds and campaign != ANY

    def close(self) -> None:
        """Stop listening; a waiting `next` ends."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
            self._changed.notify_all()
        self._subscriptions.close()

    def __next__(self) -> LabEvent:
        """Wait for the next event; raises LabTimeoutError after too long a silence."""
        began = time.monotonic()
        while True:
            with self._changed:
                left = self._silence_seconds - (time.monotonic() - began)
                wait = max(0.0, min(left, POLL_SECONDS))
                self._changed.wait_for(lambda: self._waiting or self._closed, wait)
                if self._closed:
                    raise StopIteration
                item = self._waiting.popleft() if self._waiting else None
            if item is not None:
                return self._event(item)
            if time.monotonic() - began >= self._silence_seconds:
                raise LabTimeoutError(
                    f"The lab was silent for {self._silence_seconds:g} s; `duralab status` shows which services run."
                )
            if (ended := self._ask.failure()) is not None:
                raise ended
            if self._polls and (status := self._asked()).phase in ENDED:
                # The campaign's last event was lost.
                return self._event(status)

    def _asked(self) -> iterator_pb2.CampaignStatus:
        key = self._ask.key("campaign", self._ask.bus.keys.campaign, self._campaign)
        return self._ask.query(key, iterator_pb2.CampaignRequest(), iterator_pb2.CampaignStatus)

    def _put(self, item: StreamItem[Any] | iterator_pb2.CampaignStatus) -> None:
        with self._changed:
            if len(self._waiting) >= MOST_WAITING:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(item)
            self._changed.notify()

    def _event(self, item: StreamItem[Any] | iterator_pb2.CampaignStatus) -> LabEvent:
        if isinstance(item, iterator_pb2.CampaignStatus):
            return self._campaign_event(item)
        match item.message:
            case rig_pb2.RigState() as state:
                return RigEvent(RigState.from_message(state))
            case rig_pb2.SignalBlock() as block:
                return self._signals_event(rig_of(item.key), block)
            case sequencer_pb2.EnduranceEvent() as endurance:
                return EnduranceEvent(EnduranceProgress.from_message(endurance.status))
            case event:
                return self._campaign_event(event.status)

    def _campaign_event(self, status: iterator_pb2.CampaignStatus) -> CampaignEvent:
        ended = status.phase in ENDED
        if ended and status.id == self._campaign:
            self.close()
        return CampaignEvent(status.id, progress_of(status), ended)

    def _signals_event(self, rig: str, block: rig_pb2.SignalBlock) -> SignalsEvent:
        if rig not in self._rigs:
            self._rigs[rig] = self._describe(rig)
        described, rate = self._rigs[rig], block.sample_rate
        drive = from_array(block.drive, field="drive", shape=(len(described.drives), None))
        response = from_array(block.response, field="response", shape=(len(described.responses), None))
        return SignalsEvent(
            rig=rig,
            run=block.run,
            first_sample=block.first_sample,
            drive=Signals(described.drives, rate, drive),
            response=Signals(described.responses, rate, response),
            last=block.last,
        )

    def __enter__(self) -> Self:
        """Return the watch, which already listens."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop listening."""
        self.close()
