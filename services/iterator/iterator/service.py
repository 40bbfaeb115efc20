"""Iterator on the bus: starts campaigns, reports their status, stops them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import date
from types import TracebackType
from typing import Final, Self

import structlog

from duralab_bus import (
    Admissions,
    Admitted,
    Bus,
    BusError,
    Call,
    FaultError,
    ServiceConfig,
    SpanKind,
    SpoolFullError,
    described_rig,
    span,
)
from duralab_proto.channels import overdue_calibrations
from duralab_proto.keys import ANY, check_rig, id_of
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2
from iterator.campaign import (
    Campaign,
    CampaignBoard,
    RecordedCampaign,
    Resumption,
    check_at_target,
    expect_free_id,
    finished_unseen,
    go_on_recording,
    identification_request,
    identification_run,
    is_final,
    known_experiment,
    lacks_copies,
    new_campaign,
    plan_campaign,
    read_campaign,
    read_known_before,
    read_parent,
    require_id,
    require_name,
    require_no_settings,
    require_same_rig,
    same_campaign,
)
from iterator.pre_test import perform_pre_test, require_pre_test

SERVICE: Final = "iterator"
"""Name of the service, as in its liveliness key."""

# Longest wait of a stop for the end of the campaign before it answers with the status.
_STOP_SECONDS: Final = 8.0
# Number of ended campaigns whose status is kept; the recorder has the older ones.
_KEPT_STATUSES: Final = 100
# The process must end within 3 s of the request, with or without its campaigns.
_CLOSE_SECONDS: Final = 1.5


class IteratorConfig(ServiceConfig):
    """Configuration of the iterator: that of every service."""


class _CampaignMetrics:
    """Metrics of the running campaigns; an ended one is only counted, so that the metrics do not grow for months.

    `bus`: Bus whose process publishes them. `running`: Returns the status of every campaign that has not ended.
    """

    def __init__(self, bus: Bus, running: Callable[[], Iterable[iterator_pb2.CampaignStatus]]) -> None:
        self._ended = bus.metrics.count(
            "duralab_campaigns_ended_total", "Campaigns that ended, by phase", labels=("phase",)
        )
        no_labels: tuple[str, ...] = ()
        bus.metrics.follow(
            "duralab_campaigns_running", "Campaigns under way", lambda: {no_labels: float(len(list(running())))}
        )
        readings: tuple[tuple[str, str, Callable[[iterator_pb2.CampaignStatus], float | None]], ...] = (
            ("fraction", "Share of the campaign that is done", lambda status: status.fraction),
            ("playbacks", "Playbacks of the target that are done", lambda status: len(status.iterations)),
            ("relative_rms_error", "Error of the last playback over all channels", _last_error),
            ("remaining_seconds", "Expected time to the end", _remaining),
        )
        for name, what, read in readings:
            bus.metrics.follow(
                f"duralab_campaign_{name}",
                what,
                lambda read=read: _by_campaign(running(), read),
                labels=("campaign",),
            )

    def ended(self, status: iterator_pb2.CampaignStatus) -> None:
        """Count a campaign that ended."""
        self._ended.add(iterator_pb2.CampaignPhase.Name(status.phase).removeprefix("CAMPAIGN_PHASE_"))


def _by_campaign(
    statuses: Iterable[iterator_pb2.CampaignStatus], read: Callable[[iterator_pb2.CampaignStatus], float | None]
) -> Mapping[tuple[str, ...], float]:
    values = ((status.id, read(status)) for status in statuses)
    return {(id,): float(value) for id, value in values if value is not None}


def _last_error(status: iterator_pb2.CampaignStatus) -> float | None:
    return status.iterations[-1].overall_relative_rms_error if status.iterations else None


def _remaining(status: iterator_pb2.CampaignStatus) -> float | None:
    return status.remaining_seconds if status.remaining_seconds >= 0.0 else None


class IteratorService:
    """Manages the campaigns of this process, one at a time on each rig; a context manager that stops all on exit.

    `bus`: Bus whose keys are served from the start.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._lock = threading.Lock()
        self._campaigns = Admissions[Campaign, iterator_pb2.CampaignStatus]("campaign", kept=_KEPT_STATUSES)
        # Campaigns that a resume reads and checks now.
        self._resumed: set[str] = set()
        self._metrics = _CampaignMetrics(bus, self._running)
        keys = bus.keys
        bus.serve(keys.campaign_start(ANY), iterator_pb2.CampaignSpec, self.start)
        bus.serve(keys.campaign(ANY), iterator_pb2.CampaignRequest, self.status)
        # Separate workers: a stop must not wait for other requests.
        bus.serve(keys.campaign_stop(ANY), iterator_pb2.StopCampaignRequest, self.stop, workers=4)
        bus.serve(keys.campaign_resume(ANY, ANY), iterator_pb2.ResumeCampaignRequest, self.resume)
        bus.serve(keys.campaign_decide(ANY, ANY), iterator_pb2.Decision, self.decide)
        bus.serve(keys.pre_test(ANY), iterator_pb2.PreTestRequest, self.pre_test)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        running = self._campaigns.running()
        for entry in running:
            if entry.work is not None:
                entry.work.stop("the iterator was told to end", latch=False)
        until = time.monotonic() + _CLOSE_SECONDS
        for entry in running:
            entry.board.wait_ended(max(0.0, until - time.monotonic()))

    def start(self, spec: iterator_pb2.CampaignSpec, call: Call) -> iterator_pb2.CampaignStatus:
        """Check a campaign and start it; answer at once."""
        require_id(spec.id)
        require_name(check_rig, spec.rig, field="rig")
        call.require_rig(spec.rig, field="rig")
        if spec.parent or spec.parent_iteration:
            raise FaultError(
                query_pb2.FAULT_CODE_INVALID_ARGUMENT,
                f"parent is {spec.parent!r}; it is set by the iterator alone, ask it to resume that campaign.",
                field="parent",
            )
        with self._campaigns.admitting(spec.id, spec.rig):
            call.progress("checking", 0.0, detail=f"campaign {spec.id}")
            expect_free_id(self._bus, spec.id)
            return self._begin(spec)

    def _begin(
        self, spec: iterator_pb2.CampaignSpec, resumption: Resumption | None = None
    ) -> iterator_pb2.CampaignStatus:
        """Check a campaign against its rig and start it."""
        description = described_rig(self._bus, spec.rig)
        if resumption is not None and resumption.model is not None:
            require_same_rig(resumption.model, description)
        if spec.known.HasField("model"):
            experiment = known_experiment(spec, description, is_new=resumption is None)
        else:
            # The identifier makes the same drive and checks it, before anything is stored or moves.
            request = identification_request(spec, run=identification_run(spec), check_only=True)
            experiment = self._bus.query(self._bus.keys.identify(spec.rig), request, identifier_pb2.Model).plan
            if spec.HasField("at_target"):
                request = check_at_target(spec)
                second = self._bus.query(self._bus.keys.identify(spec.rig), request, identifier_pb2.Model).plan
                experiment.duration_seconds += second.duration_seconds
        with span("transform the target", SpanKind.MATHEMATICS):
            plan = plan_campaign(spec, description, experiment)
        tested = require_pre_test(self._bus, spec, description)
        overdue = overdue_calibrations(description.responses, today=date.today())
        remarks = (*overdue, *([tested] if tested else ()), *plan.remarks)
        board = CampaignBoard(spec.id, publish=self._publishing(spec.id), remarks=remarks)
        campaign = Campaign(
            plan,
            bus=self._bus,
            board=board,
            on_end=lambda: self._campaigns.end(spec.id, spec.rig),
            resumption=resumption,
            known=read_known_before(self._bus, plan),
        )
        self._campaigns.begin(spec.id, campaign, board)
        accepted = board.snapshot()
        structlog.get_logger(SERVICE).info("campaign accepted", campaign=spec.id, rig=spec.rig, parent=spec.parent)
        campaign.start()
        return accepted

    def status(self, request: iterator_pb2.CampaignRequest, call: Call) -> iterator_pb2.CampaignStatus:
        """Return the status of a campaign."""
        del request
        return self._entry(id_of(call.key)).board.snapshot()

    def stop(self, request: iterator_pb2.StopCampaignRequest, call: Call) -> iterator_pb2.CampaignStatus:
        """Stop a campaign, and stop and latch its rig in any state; one that has ended stays unchanged."""
        entry = self._entry(id_of(call.key))
        if not entry.board.ended:
            if entry.work is not None:
                entry.work.stop(request.reason or "no reason was given")
            call.progress("stopping", 0.0)
            entry.board.wait_ended(_STOP_SECONDS)
        return entry.board.snapshot()

    def decide(self, request: iterator_pb2.Decision, call: Call) -> iterator_pb2.CampaignStatus:
        """Apply a person's decision on a campaign's proposal; answer when it is stored."""
        entry = self._entry(id_of(call.key))
        if entry.work is None:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"Campaign {id_of(call.key)!r} has ended; it waits for no decision.",
                field="proposal",
            )
        call.require_rig(entry.work.rig, field="rig")
        entry.work.decide(request, call)
        return entry.board.snapshot()

    def resume(self, request: iterator_pb2.ResumeCampaignRequest, call: Call) -> iterator_pb2.CampaignStatus:
        """Continue a campaign that a crash interrupted, or resume one as a new campaign; answer at once."""
        id = id_of(call.key)
        with self._resuming_alone(id) as shown:
            call.progress("reading back", 0.0, detail=f"campaign {id}")
            return (
                self._resume_as_new(id, request, call)
                if request.new_id
                else self._resume_in_place(id, request, call, shown)
            )

    def pre_test(self, request: iterator_pb2.PreTestRequest, call: Call) -> iterator_pb2.PreTest:
        """Perform the pre-test of a rig that no campaign uses; answer when it is stored."""
        require_id(request.id)
        require_name(check_rig, request.rig, field="rig")
        call.require_rig(request.rig, field="rig")
        with self._campaigns.admitting(request.id, request.rig, what="pre-test"):
            stored = perform_pre_test(self._bus, request, call)
        self._campaigns.release(request.rig)
        return stored

    @contextmanager
    def _resuming_alone(self, id: str) -> Iterator[iterator_pb2.CampaignStatus | None]:
        """Refuse a second resume of a campaign until the first is decided: its data would be out of date."""
        with self._lock:
            entry = self._campaigns.get(id)
            if entry is not None and not entry.board.ended:
                raise FaultError(
                    query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                    f"Campaign {id!r} runs; wait for its end or stop it first.",
                )
            if id in self._resumed:
                raise FaultError(
                    query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                    f"Campaign {id!r} is being resumed by another request; wait for its answer.",
                )
            self._resumed.add(id)
        try:
            yield None if entry is None else entry.board.snapshot()
        finally:
            with self._lock:
                self._resumed.discard(id)

    def _resume_as_new(
        self, id: str, request: iterator_pb2.ResumeCampaignRequest, call: Call
    ) -> iterator_pb2.CampaignStatus:
        require_id(request.new_id, field="new_id")
        expect_free_id(self._bus, request.new_id, field="new_id")
        spec, resumption = new_campaign(self._recorded(id, call), request)
        with self._campaigns.admitting(spec.id, spec.rig):
            return self._begin(spec, resumption)

    def _resume_in_place(
        self,
        id: str,
        request: iterator_pb2.ResumeCampaignRequest,
        call: Call,
        shown: iterator_pb2.CampaignStatus | None,
    ) -> iterator_pb2.CampaignStatus:
        require_no_settings(request)
        recorded = self._recorded(id, call)
        if (final := finished_unseen(recorded, shown)) is not None:
            self._keep_final(id, final)
            return final
        resumption = same_campaign(recorded, read_parent(self._bus, recorded) if lacks_copies(recorded) else None)
        with self._campaigns.admitting(id, recorded.spec.rig, again=True):
            go_on_recording(self._bus, recorded)
            if recorded.final is None:
                return self._begin(recorded.spec, resumption)
            self._keep_final(id, recorded.final)
            self._campaigns.release(recorded.spec.rig)
            return recorded.final

    def _recorded(self, id: str, call: Call) -> RecordedCampaign:
        recorded = read_campaign(self._bus, id)
        call.require_rig(recorded.spec.rig, field="rig")
        return recorded

    def _keep_final(self, id: str, final: iterator_pb2.CampaignStatus) -> None:
        """Show the final status of a recording."""
        board = CampaignBoard(id, publish=self._publishing(id))
        board.end(final)
        self._campaigns.begin(id, None, board)

    def _entry(self, campaign: str) -> Admitted[Campaign, iterator_pb2.CampaignStatus]:
        entry = self._campaigns.get(campaign)
        if entry is None:
            raise FaultError(
                query_pb2.FAULT_CODE_NOT_FOUND,
                f"No campaign {campaign!r} was started since the iterator began; `duralab catalogue` lists older ones.",
                field="id",
            )
        return entry

    def _running(self) -> list[iterator_pb2.CampaignStatus]:
        return [entry.board.snapshot() for entry in self._campaigns.running()]

    def _publishing(self, campaign: str) -> Callable[[iterator_pb2.CampaignStatus], None]:
        publisher = self._bus.publisher(self._bus.keys.campaign_event(campaign))

        def publish(status: iterator_pb2.CampaignStatus) -> None:
            try:
                publisher.put(iterator_pb2.CampaignEvent(status=status))
            except (BusError, SpoolFullError) as error:
                # A recorder that is away for a night must not end the campaign that waits for it either.
                structlog.get_logger(SERVICE).warning("An event was not published.", campaign=campaign, why=str(error))
            if is_final(status):
                self._metrics.ended(status)
                publisher.close()

        return publish
