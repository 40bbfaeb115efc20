"""The iterator on the bus: starts campaigns, tells about them, stops them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Final, Self

import structlog

from duralab_proto.keys import ANY, MAIN_INSTANCE, check_id, check_rig, id_of
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator.campaign import Campaign
from iterator.campaign_plan import plan_campaign
from iterator.identification import identification_request
from iterator.status_board import StatusBoard, is_final
from labbus import Bus, BusError, Call, FaultError, ServiceConfig

SERVICE: Final = "iterator"
"""Name of the service, as in its liveliness key."""

_DISCOVERY_SECONDS: Final = 1.5
# A stop waits so long for the campaign to end before it answers how far it got.
_STOP_SECONDS: Final = 8.0
# Ended campaigns whose status can still be asked for; the recorder knows the older ones.
_KEPT_STATUSES: Final = 100
# The process ends within 3 s of being told to, with or without its campaigns.
_CLOSE_SECONDS: Final = 1.5


class IteratorConfig(ServiceConfig):
    """Configuration of the iterator; nothing beyond what every service has."""


@dataclass(frozen=True)
class _Entry:
    """A campaign of this process; one that has ended keeps its status only."""

    campaign: Campaign | None
    board: StatusBoard


class IteratorService:
    """Keeps the campaigns of this process; one at a time on each rig. A context manager: leaving it stops all.

    Parameters
    ----------
    bus : Bus
        Its keys are served from the start.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._lock = threading.Lock()
        self._entries: dict[str, _Entry] = {}
        # Rig to the campaign that has it, from the checks to the end.
        self._taken_rigs: dict[str, str] = {}
        keys = bus.keys
        bus.serve(keys.campaign_start(), iterator_pb2.CampaignSpec, self.start)
        bus.serve(keys.campaign(ANY), iterator_pb2.CampaignRequest, self.status)
        # A worker of its own: a stop must get through whatever else is asked.
        bus.serve(keys.campaign_stop(ANY), iterator_pb2.StopCampaignRequest, self.stop, workers=4)
        bus.serve(keys.campaign_resume(ANY), iterator_pb2.ResumeCampaignRequest, self.resume)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            running = [entry for entry in self._entries.values() if not entry.board.ended]
        for entry in running:
            if entry.campaign is not None:
                entry.campaign.stop("the iterator was told to end")
        until = time.monotonic() + _CLOSE_SECONDS
        for entry in running:
            entry.board.wait_ended(max(0.0, until - time.monotonic()))

    def start(self, spec: iterator_pb2.CampaignSpec, call: Call) -> iterator_pb2.CampaignStatus:
        """Check a campaign and start it; answer at once.

        Parameters
        ----------
        spec : CampaignSpec
            As received.
        call : Call
            Told what is checked.

        Returns
        -------
        CampaignStatus
            In the phase CHECKING; the rest is published.

        Raises
        ------
        FaultError
            INVALID_ARGUMENT, NOT_FOUND, ALREADY_EXISTS or BUSY with the field, UNAVAILABLE for a missing service.
        """
        for check, name, field in ((check_id, spec.id, "id"), (check_rig, spec.rig, "rig")):
            try:
                check(name)
            except ValueError as error:
                raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field=field) from error
        self._take(spec)
        try:
            call.progress("checking", 0.0, detail=f"campaign {spec.id}")
            description = self._described_rig(spec.rig)
            self._expect_free(spec)
            # The identifier makes the very drive and checks it, before anything is stored or moves.
            request = identification_request(spec, check_only=True)
            experiment = self._bus.query(self._bus.keys.identify(), request, identifier_pb2.Model).plan
            plan = plan_campaign(spec, description, experiment)
            board = StatusBoard(spec.id, publish=self._publishing(spec.id))
            campaign = Campaign(plan, bus=self._bus, board=board, on_end=lambda: self._ended(spec))
        except BaseException:
            self._release(spec.rig)
            raise
        with self._lock:
            self._entries[spec.id] = _Entry(campaign=campaign, board=board)
        accepted = board.snapshot()
        structlog.get_logger(SERVICE).info("campaign accepted", campaign=spec.id, rig=spec.rig)
        campaign.start()
        return accepted

    def status(self, request: iterator_pb2.CampaignRequest, call: Call) -> iterator_pb2.CampaignStatus:
        """Tell how a campaign stands.

        Parameters
        ----------
        request : CampaignRequest
            Empty.
        call : Call
            Its key names the campaign.

        Returns
        -------
        CampaignStatus
            Now.

        Raises
        ------
        FaultError
            NOT_FOUND.
        """
        del request
        return self._entry(id_of(call.key)).board.snapshot()

    def stop(self, request: iterator_pb2.StopCampaignRequest, call: Call) -> iterator_pb2.CampaignStatus:
        """Stop a campaign and its playback; one that has ended stays as it is.

        Parameters
        ----------
        request : StopCampaignRequest
            Why.
        call : Call
            Its key names the campaign.

        Returns
        -------
        CampaignStatus
            After the end, in the phase STOPPED; as far as it got where that takes too long.

        Raises
        ------
        FaultError
            NOT_FOUND.
        """
        entry = self._entry(id_of(call.key))
        if not entry.board.ended:
            call.progress("stopping", 0.0)
            if entry.campaign is not None:
                entry.campaign.stop(request.reason or "no reason was given")
            entry.board.wait_ended(_STOP_SECONDS)
        return entry.board.snapshot()

    def resume(self, request: iterator_pb2.ResumeCampaignRequest, call: Call) -> iterator_pb2.CampaignStatus:
        """Refuse: campaigns cannot be resumed yet.

        Parameters
        ----------
        request : ResumeCampaignRequest
            Empty.
        call : Call
            Its key names the campaign.

        Raises
        ------
        FaultError
            UNIMPLEMENTED, always.
        """
        del request
        raise FaultError(
            query_pb2.FAULT_CODE_UNIMPLEMENTED,
            f"Campaign {id_of(call.key)!r} cannot be resumed, this iterator does not offer it; start a new campaign.",
        )

    def _entry(self, campaign: str) -> _Entry:
        with self._lock:
            entry = self._entries.get(campaign)
        if entry is None:
            raise FaultError(
                query_pb2.FAULT_CODE_NOT_FOUND,
                f"No campaign {campaign!r} was started since this iterator began; the recorder lists older ones.",
                field="id",
            )
        return entry

    def _take(self, spec: iterator_pb2.CampaignSpec) -> None:
        with self._lock:
            if spec.id in self._entries or spec.id in self._taken_rigs.values():
                raise _already_exists(spec.id)
            if (holder := self._taken_rigs.get(spec.rig)) is not None:
                raise FaultError(
                    query_pb2.FAULT_CODE_BUSY,
                    f"Rig {spec.rig!r} is in use by campaign {holder!r}; wait for its end or stop it.",
                    field="rig",
                )
            self._taken_rigs[spec.rig] = spec.id

    def _ended(self, spec: iterator_pb2.CampaignSpec) -> None:
        """Free the rig, and let go of everything about a campaign but its status."""
        with self._lock:
            self._entries[spec.id] = _Entry(campaign=None, board=self._entries[spec.id].board)
            ended = [id for id, entry in self._entries.items() if entry.campaign is None]
            for id in ended[:-_KEPT_STATUSES]:
                del self._entries[id]
        self._release(spec.rig)

    def _release(self, rig: str) -> None:
        with self._lock:
            del self._taken_rigs[rig]

    def _described_rig(self, rig: str) -> rig_pb2.RigDescription:
        """Ask a rig what it is and whether it can play now."""
        keys = self._bus.keys
        try:
            key = keys.rig_description(rig)
            description = self._bus.query(key, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
        except FaultError as fault:
            if fault.code != query_pb2.FAULT_CODE_UNAVAILABLE or self._bus.live("rig_sim", rig):
                raise
            raise FaultError(query_pb2.FAULT_CODE_NOT_FOUND, fault.message, field="rig") from fault
        state = self._bus.query(keys.rig_state(rig), rig_pb2.StateRequest(), rig_pb2.RigState)
        if state.mode == rig_pb2.RIG_MODE_INTERLOCKED:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Rig {rig!r} is interlocked ({state.reason}); see to the reason and reset it first.",
                field="rig",
            )
        if state.mode != rig_pb2.RIG_MODE_IDLE:
            raise FaultError(
                query_pb2.FAULT_CODE_BUSY, f"Rig {rig!r} plays run {state.run!r}; wait for its end.", field="rig"
            )
        return description

    def _expect_free(self, spec: iterator_pb2.CampaignSpec) -> None:
        """Raise when the id has a recording, or a service that the campaign needs is not there."""
        self._bus.wait_for_live({("identifier", MAIN_INSTANCE)}, _DISCOVERY_SECONDS)
        try:
            self._bus.query(
                self._bus.keys.recording(spec.id), recorder_pb2.RecordingRequest(), recorder_pb2.RecordingInfo
            )
        except FaultError as fault:
            if fault.code == query_pb2.FAULT_CODE_NOT_FOUND:
                return
            raise
        raise _already_exists(spec.id)

    def _publishing(self, campaign: str) -> Callable[[iterator_pb2.CampaignStatus], None]:
        publisher = self._bus.publisher(self._bus.keys.campaign_event(campaign))

        def publish(status: iterator_pb2.CampaignStatus) -> None:
            try:
                publisher.put(iterator_pb2.CampaignEvent(status=status))
                if is_final(status):
                    publisher.close()
            except BusError as error:
                structlog.get_logger(SERVICE).warning("An event was not published.", campaign=campaign, why=str(error))

        return publish


def _already_exists(campaign: str) -> FaultError:
    return FaultError(
        query_pb2.FAULT_CODE_ALREADY_EXISTS,
        f"A campaign {campaign!r} exists already; its recording is never overwritten, choose another id.",
        field="id",
    )
