"""State of the lab on the page: updated by threads, read by every open page."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import structlog

from duralab import CampaignEvent, EnduranceEvent, LabError, RigEvent, RigMode, RigState, RunProgress, SignalsEvent
from duralab.lab import Lab, ServiceHealth
from duralab_bus import BusError
from operator_page.deliberation import Holders
from operator_page.documents import campaign_document, reset_sentence, service_document
from operator_page.endurance_view import EnduranceView
from operator_page.envelope import Envelope, rounded

POLL_SECONDS = 1.0
SERVICES_SECONDS = 3.0
MOST_LOG_LINES = 500
MOST_CAMPAIGNS = 20
"""Number of ended campaigns that stay in view, the last ones."""


@dataclass
class _Run:
    """Signals of one run, thinned."""

    run: str
    rig: str
    sample_rate: float
    drive: Envelope
    response: Envelope
    over: bool = False
    number: int = 0


@dataclass
class _SeenRig:
    state: RigState
    heard: float
    runs: deque[_Run] = field(default_factory=lambda: deque(maxlen=2))


@dataclass
class _SeenCampaign:
    progress: RunProgress
    rig: str
    ended: bool
    heard: float


class LabView:
    """Live state of a lab: rigs, campaigns, endurance tests, services, a log, and the signals that are played."""

    def __init__(self, lab: Lab, holders: Holders) -> None:
        self._lab, self._holders = lab, holders
        self._log = structlog.get_logger("operator_page")
        self._lock = threading.RLock()
        self._closing = threading.Event()
        self._rigs: dict[str, _SeenRig] = {}
        self._campaigns: dict[str, _SeenCampaign] = {}
        self._services: list[ServiceHealth] = []
        self._lines: deque[dict[str, Any]] = deque(maxlen=MOST_LOG_LINES)
        self._line_number = 0
        self._run_number = 0
        self._waiting: dict[str, str] = {}
        self.changes = 0
        """Number of changes: a page with this number is up to date."""
        self.endurance = EnduranceView(lab, lock=self._lock, say=self.say)
        self._threads = [
            threading.Thread(target=self._repeat, args=(work, seconds), name=f"page-{name}", daemon=True)
            for name, work, seconds in (
                ("watch", self._watch, POLL_SECONDS),
                ("rigs", self._poll_rigs, POLL_SECONDS),
                ("services", self._poll_services, SERVICES_SECONDS),
                ("endurance", self._read_repeats, POLL_SECONDS),
            )
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop watching."""
        self._closing.set()

    def _repeat(self, work: Callable[[], None], seconds: float) -> None:
        while not self._closing.is_set():
            try:
                work()
            except (LabError, BusError) as error:
                self.say(str(error), trouble=True)
            except Exception:  # noqa: BLE001 - what cannot be shown now may be in a second
                self._log.exception("the view of the lab could not be brought up to date")
            self._closing.wait(seconds)

    def _watch(self) -> None:
        with self._lab.watch() as watch:
            for event in watch:
                if self._closing.is_set():
                    return
                match event:
                    case RigEvent(state):
                        self._take_state(state)
                    case CampaignEvent():
                        self._take_campaign(event)
                    case SignalsEvent():
                        self._take_signals(event)
                    case EnduranceEvent(progress):
                        self.endurance.take(progress)
                        self._count_change()

    def _count_change(self) -> None:
        with self._lock:
            self.changes += 1

    def _read_repeats(self) -> None:
        while self.endurance.read() and not self._closing.is_set():
            self._count_change()

    def _poll_rigs(self) -> None:
        names = self._lab.rig_names()
        with self._lock:
            for gone in self._rigs.keys() - set(names):
                del self._rigs[gone]
                self.say(f"The rig {gone} left the lab.", trouble=True)
                self.changes += 1
        with ThreadPoolExecutor(max(1, len(names))) as pool:
            list(pool.map(self._poll_rig, names))

    def _poll_rig(self, name: str) -> None:
        # If it does not answer, its last state becomes older, which the page shows.
        with suppress(LabError, BusError):
            self._take_state(self._lab.state(name))

    def _poll_services(self) -> None:
        services = self._lab.health()
        with self._lock:
            self._services = services
            self.changes += 1

    def _take_state(self, state: RigState) -> None:
        with self._lock:
            before = self._rigs.get(state.rig)
            if before is None:
                self._rigs[state.rig] = _SeenRig(state, time.time())
                self.say(f"The rig {state.rig} is {state.mode}." + (f" {state.reason}" if state.reason else ""))
            else:
                latched = state.mode is RigMode.INTERLOCKED
                # The modes of every repeat of an endurance test would remove all other lines from the log.
                silent = not latched and before.state.mode is not RigMode.INTERLOCKED and self.endurance.on(state.rig)
                if (state.mode, state.reason) != (before.state.mode, before.state.reason) and not silent:
                    line = f"{state.rig}: {state.mode}" + (f": {state.reason}" if state.reason else "")
                    if before.state.mode is RigMode.INTERLOCKED and (reset := reset_sentence(state)):
                        line += f". {reset}"
                    self.say(line, trouble=latched)
                before.state, before.heard = state, time.time()
            self.changes += 1

    def _take_campaign(self, event: CampaignEvent) -> None:
        known = self._campaigns.get(event.id)
        # The first events come before the recording that names the rig.
        rig = known.rig if known is not None and known.rig else self._rig_of(event.id)
        with self._lock:
            progress = event.progress
            if known is None or known.progress.activity != progress.activity:
                self.say(f"{event.id}: {progress.activity}")
            self._campaigns[event.id] = _SeenCampaign(progress, rig, event.ended, time.time())
            ended = [id for id, each in self._campaigns.items() if each.ended]
            for id in ended[: max(0, len(ended) - MOST_CAMPAIGNS)]:
                del self._campaigns[id]
            self.changes += 1

    def _rig_of(self, campaign: str) -> str:
        with suppress(LabError, BusError):
            return next((entry.rig for entry in self._lab.catalogue.search() if entry.id == campaign), "")
        return ""

    def _take_signals(self, event: SignalsEvent) -> None:
        with self._lock:
            rig = self._rigs.get(event.rig)
            if rig is None:
                return
            if not rig.runs or rig.runs[-1].run != event.run:
                self._run_number += 1
                rig.runs.append(
                    _Run(
                        event.run,
                        event.rig,
                        event.response.sample_rate,
                        Envelope(len(event.drive.channels)),
                        Envelope(len(event.response.channels)),
                        number=self._run_number,
                    )
                )
            run = rig.runs[-1]
            run.drive.put(event.first_sample, event.drive.samples)
            run.response.put(event.first_sample, event.response.samples)
            run.over = event.last
            self.changes += 1

    def say(self, text: str, *, trouble: bool = False, who: str = "", attempt: str = "") -> None:
        """Add a line to the log that every page shows; a repetition of the last line is left out.

        `attempt`: Command that the line is about, for the answer line of the window that gave it.
        """
        with self._lock:
            if not attempt and self._lines and self._lines[-1]["text"] == text and trouble:
                self._lines[-1]["when"] = time.time()
                return
            self._line_number += 1
            line = {"number": self._line_number, "when": time.time(), "text": text, "trouble": trouble, "who": who}
            line |= {"attempt": attempt} if attempt else {}
            self._lines.append(line)
            self.changes += 1

    def wait_with(self, rig: str, activity: str) -> None:
        """Show what a rig is being prepared for; empty to end it."""
        with self._lock:
            self._waiting.pop(rig, None)
            if activity:
                self._waiting[rig] = activity
            self.changes += 1

    def campaigns_on(self, rig: str) -> list[str]:
        """Return the running campaigns on a rig."""
        with self._lock:
            return [id for id, each in self._campaigns.items() if each.rig == rig and not each.ended]

    def rig_of(self, campaign: str) -> str:
        """Return the rig of a campaign; empty if it is not known."""
        known = self._campaigns.get(campaign)
        return known.rig if known is not None and known.rig else self._rig_of(campaign)

    def document(self, *, after_line: int) -> dict[str, Any]:
        """Return everything except signals, and the lines of the log after a number."""
        now = time.time()
        with self._lock:
            return {
                "now": now,
                "rigs": [self._rig_document(name, seen, now) for name, seen in sorted(self._rigs.items())],
                "campaigns": [
                    campaign_document(id, each.progress, rig=each.rig, ended=each.ended, age=now - each.heard)
                    for id, each in self._campaigns.items()
                ],
                "endurance": self.endurance.documents(now),
                "services": [service_document(each) for each in self._services],
                "log": [line for line in self._lines if line["number"] > after_line],
            }

    def _rig_document(self, name: str, seen: _SeenRig, now: float) -> dict[str, Any]:
        state, holder = seen.state, self._holders.of(name)
        return {
            "name": name,
            "mode": state.mode.value,
            "reason": state.why,
            "reset": reset_sentence(state),
            "run": state.run,
            "fraction": state.fraction,
            "age": now - seen.heard,
            "holder": None if holder is None else {"name": holder.name, "since": holder.since},
            "waiting": self._waiting.get(name, ""),
        }

    def signals(self, seen: dict[str, tuple[int, int, int]]) -> list[dict[str, Any]]:
        """Return the new part of each rig's run; `seen` (run, bucket length, buckets sent) is updated."""
        parts = []
        with self._lock:
            for name, rig in self._rigs.items():
                if not rig.runs:
                    continue
                run = rig.runs[-1]
                number, length, sent = seen.get(name, (0, 0, 0))
                response = run.response
                if (number, length) != (run.number, response.bucket_samples):
                    sent = 0
                if sent >= response.used and number == run.number:
                    continue
                # The last bucket may still grow.
                first = max(0, sent - 1)
                low, high = response.part(first)
                drive_low, drive_high = run.drive.part(first)
                parts.append(
                    {
                        "rig": name,
                        "run": run.run,
                        "first": first,
                        "bucket_seconds": response.bucket_samples / run.sample_rate,
                        "over": run.over,
                        "response": [rounded(low), rounded(high)],
                        "drive": [rounded(drive_low), rounded(drive_high)],
                    }
                )
                seen[name] = (run.number, response.bucket_samples, response.used)
        return parts
