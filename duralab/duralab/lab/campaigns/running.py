"""A campaign as the SDK drives it: a free name, followed to its end, stopped, collected."""

from __future__ import annotations

import queue
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Final

from duralab.errors import CampaignFaultError, LabError, ServiceEndedError, ended
from duralab.lab.campaigns.fetching import Recovery, fetch_result
from duralab.lab.campaigns.result import CampaignResult
from duralab.lab.client import FOREVER, Deadline, LabClient
from duralab.lab.progress import ENDED, POLL_SECONDS, OnProgress, progress_of
from duralab_bus import BusError, FaultError, StreamItem
from duralab_proto.v1 import iterator_pb2, recorder_pb2

SILENCE_SECONDS: Final = 10.0
_STOP_SILENCE_SECONDS: Final = 2.0


def free_id(ask: LabClient, name: str, *, first: int = 1) -> str:
    """Return the campaign's name, with a number where the lab's recorder holds one of that name already."""
    taken = {
        information.recording
        for information in ask.query(
            ask.bus.keys.recordings(), recorder_pb2.ListRecordingsRequest(), recorder_pb2.RecordingList
        ).recordings
    }
    numbered = (name if number == 1 else f"{name}-{number}" for number in range(first, first + len(taken) + 1))
    return next(candidate for candidate in numbered if candidate not in taken)


def followed(
    ask: LabClient,
    id: str,
    *,
    begin: Callable[[], iterator_pb2.CampaignStatus],
    tell: OnProgress,
    recovery: Recovery,
    deadline: Deadline = FOREVER,
) -> iterator_pb2.CampaignStatus:
    """Begin a campaign and follow it to its end; whatever else ends that, stops it and tells where its recording is."""
    begun, played = False, False
    bus, events = ask.bus, queue.SimpleQueue[iterator_pb2.CampaignStatus]()

    def put(item: StreamItem[iterator_pb2.CampaignEvent]) -> None:
        events.put(item.message.status)

    def stopped(reason: str, *, silence_seconds: float = SILENCE_SECONDS) -> None:
        # Best effort: the services that are left are ended with the lab.
        with suppress(FaultError, BusError):
            stop_campaign(ask, id, reason=reason, silence_seconds=silence_seconds)

    try:
        try:
            key = bus.keys.campaign_event(id)
            with closing(bus.subscribe(key, iterator_pb2.CampaignEvent, put, repair=True)):
                status, begun = begin(), True
                while True:
                    played = bool(status.iterations)
                    if (failure := ask.failure()) is not None:
                        raise failure
                    tell(progress_of(status))
                    if status.phase in ENDED:
                        return status
                    if deadline.is_set():
                        raise deadline.error(f"The campaign {id!r}")
                    try:
                        status = events.get(timeout=POLL_SECONDS)
                    except queue.Empty:
                        key, request = bus.keys.campaign(id), iterator_pb2.CampaignRequest()
                        status = bus.query(key, request, iterator_pb2.CampaignStatus)
        except FaultError as fault:
            error = ask.explained(fault)
            # What was refused has left nothing behind.
            raise (recovery.told(error, played=played) if begun else error) from fault
        except LabError as error:
            ended_itself = isinstance(error, ServiceEndedError)
            stopped(str(error), silence_seconds=_STOP_SILENCE_SECONDS if ended_itself else SILENCE_SECONDS)
            raise recovery.told(error, played=played) from error
    except KeyboardInterrupt as interrupt:
        try:
            # Whoever interrupts does not want to wait for a service that is gone.
            stopped("interrupted by the user", silence_seconds=_STOP_SILENCE_SECONDS)
            recovery.told(interrupt, played=played)
        except KeyboardInterrupt as again:
            recovery.told(again, played=played, fetch=False)
            raise
        raise


def stop_campaign(
    ask: LabClient, id: str, *, reason: str, silence_seconds: float = SILENCE_SECONDS
) -> iterator_pb2.CampaignStatus:
    """Stop a campaign; raises FaultError where the iterator does not know it."""
    return ask.bus.query(
        ask.key("id", ask.bus.keys.campaign_stop, id),
        iterator_pb2.StopCampaignRequest(reason=reason),
        iterator_pb2.CampaignStatus,
        silence_seconds=silence_seconds,
    )


def collect(
    ask: LabClient,
    specification: iterator_pb2.CampaignSpec,
    status: iterator_pb2.CampaignStatus,
    *,
    folder: Path,
    recovery: Recovery,
) -> CampaignResult:
    """Fetch what a campaign left; raises CampaignFaultError where it ended early, after fetching what there is."""
    if status.phase != iterator_pb2.CAMPAIGN_PHASE_FINISHED:
        error = ask.failure() or CampaignFaultError(
            ended(status.fault.message or f"The campaign {status.id!r} ended early: {status.activity}"),
            field=status.fault.field,
            service=status.fault.service,
        )
        raise recovery.told(error, played=bool(status.iterations))
    try:
        result = fetch_result(ask.bus, specification, status, folder=folder)
    except FaultError as fault:
        raise recovery.told(ask.explained(fault), played=True, fetch=False) from fault
    except LabError as error:
        raise recovery.told(error, played=True, fetch=False) from error
    except KeyboardInterrupt as interrupt:
        recovery.told(interrupt, played=True, fetch=False)
        raise
    recovery.place.fetched.add(specification.id)
    return result
