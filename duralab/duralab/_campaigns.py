"""A campaign as the SDK drives it: a free name, followed to its end, stopped, collected."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from duralab._asking import Asking
from duralab._fetching import fetch_result
from duralab._following import ENDED, OnProgress, follow_campaign, progress_of
from duralab._patience import FOREVER, Patience
from duralab.campaign_result import CampaignResult
from duralab.errors import CampaignFaultError, LabError, LabTimeoutError, StoppedError
from duralab.sentences import ended
from duralab_proto.v1 import iterator_pb2, recorder_pb2
from labbus import BusError, FaultError

SILENCE_SECONDS: Final = 10.0
_STOP_SILENCE_SECONDS: Final = 2.0


def free_id(ask: Asking, name: str) -> str:
    """Return the campaign's name, with a number where the lab's recorder holds one of that name already."""
    taken = {
        information.recording
        for information in ask.query(
            ask.bus.keys.recordings(), recorder_pb2.ListRecordingsRequest(), recorder_pb2.RecordingList
        ).recordings
    }
    numbered = (name if number == 1 else f"{name}-{number}" for number in range(1, len(taken) + 2))
    return next(candidate for candidate in numbered if candidate not in taken)


def followed(
    ask: Asking,
    id: str,
    *,
    begin: Callable[[], iterator_pb2.CampaignStatus],
    tell: OnProgress,
    patience: Patience = FOREVER,
) -> iterator_pb2.CampaignStatus:
    """Begin a campaign and follow it to its end; an interrupt and the end of the patience stop it."""

    def on_status(status: iterator_pb2.CampaignStatus) -> None:
        if (failure := ask.failure()) is not None:
            raise failure
        tell(progress_of(status))
        if patience.is_set() and status.phase not in ENDED:
            raise patience.error(f"The campaign {id!r}")

    try:
        return follow_campaign(ask.bus, id, begin=begin, on_status=on_status)
    except FaultError as fault:
        raise ask.explained(fault) from fault
    except (StoppedError, LabTimeoutError) as error:
        with suppress(FaultError, BusError):
            stop_campaign(ask, id, reason=str(error))
        raise type(error)(f"{ended(str(error))} What was played until then is in its recording.") from error
    except KeyboardInterrupt:
        # Best effort: whoever interrupts does not want to wait for a service that is gone.
        with suppress(FaultError, BusError):
            stop_campaign(ask, id, reason="interrupted by the user", silence_seconds=_STOP_SILENCE_SECONDS)
        raise


def stop_campaign(
    ask: Asking, id: str, *, reason: str, silence_seconds: float = SILENCE_SECONDS
) -> iterator_pb2.CampaignStatus:
    """Stop a campaign; raises FaultError where the iterator does not know it."""
    return ask.bus.query(
        ask.key("id", ask.bus.keys.campaign_stop, id),
        iterator_pb2.StopCampaignRequest(reason=reason),
        iterator_pb2.CampaignStatus,
        silence_seconds=silence_seconds,
    )


def collect(
    ask: Asking, specification: iterator_pb2.CampaignSpec, status: iterator_pb2.CampaignStatus, *, folder: Path
) -> CampaignResult:
    """Fetch what a campaign left; raises CampaignFaultError where it ended early, after fetching what there is."""
    if status.phase != iterator_pb2.CAMPAIGN_PHASE_FINISHED:
        if (failure := ask.failure()) is not None:
            raise failure
        sentence = ended(status.fault.message or f"The campaign {status.id!r} ended early: {status.activity}")
        if status.iterations:
            with suppress(FaultError, LabError):
                kept = fetch_result(ask.bus, specification, status, folder=folder).recording_path
                sentence += f" What was played until then is in {kept}; `duralab report` shows it."
        raise CampaignFaultError(
            sentence,
            field=status.fault.field,
            service=status.fault.service,
        )
    try:
        return fetch_result(ask.bus, specification, status, folder=folder)
    except FaultError as fault:
        raise ask.explained(fault) from fault
