"""Commands of the page, carried out in the lab and logged with the person's name."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path
from typing import Any

import structlog

from duralab import Campaign, InputError, LabError, load_campaign, load_schedule, shipped_campaigns
from duralab.campaign import missing_target
from duralab.lab import Lab
from duralab_bus import BusError
from operator_page.deliberation import Holders
from operator_page.files import PLACES, fetched_drives
from operator_page.lab_view import LabView
from operator_page.requests import Begin, BeginEndurance, Decide, DecideEndurance, Resume

ANSWER_SECONDS = 0.12
"""Longest answer time of a stop, which must be below 0.2 s: if the rig still ramps down, the stream reports rest."""


class Commands:
    """Commands of people to the lab; safe for threads."""

    def __init__(self, lab: Lab, view: LabView, holders: Holders, *, folder: Path) -> None:
        self._lab, self._view, self._holders, self.folder = lab, view, holders, folder
        self._log = structlog.get_logger("operator_page")
        self._lock = threading.Lock()
        self._beginning: dict[str, threading.Event] = {}
        # A stop never waits for another command.
        self._stops = ThreadPoolExecutor(32, thread_name_prefix="page-stop")

    def _did(self, who: str, text: str, **values: Any) -> None:
        """Report a command on every page, and in the log of the service."""
        self._log.info("command", who=who, did=text, **values)
        self._view.say(text, who=who)

    def _in_background(self, work: Callable[[], str], *, name: str, who: str, taken: Sequence[str] = ()) -> str:
        """Do something in a thread; return the attempt with which the log reports its sentence or its failure.

        `taken`: Rigs that `who` holds only for this, released if it fails.
        """
        attempt = secrets.token_hex(8)

        def run() -> None:
            try:
                self._view.say(work(), who=who, attempt=attempt)
                return
            except (LabError, BusError) as error:
                failure = str(error)
            except Exception:  # noqa: BLE001 - said on every page, and in the log
                self._log.exception("a command failed")
                failure = "The page could not carry a command out; its log says why."
            for rig in taken:
                self._holders.release(rig, who)
            self._view.say(failure, trouble=True, attempt=attempt)

        threading.Thread(target=run, name=name, daemon=True).start()
        return attempt

    def stop(self, rig: str, who: str, reason: str, attempt: str = "") -> dict[str, Any]:
        """Stop a rig and its campaign or test now; answer shortly, whether or not it is at rest.

        The log reports a later failure with `attempt`.
        """
        why = f"{reason or 'Stop'} ({who}, at the operator page)"
        attempt = attempt or secrets.token_hex(8)
        with self._lock:
            beginning = [event for name, event in self._beginning.items() if rig in name.split()]
        for event in beginning:
            event.set()
        campaigns, tests = self._view.campaigns_on(rig), self._view.endurance.on(rig)
        sent: list[Future[Any]] = [self._stops.submit(self._lab.stop_rig, rig, reason=why)]
        sent += [self._stops.submit(self._lab.stop, id, reason=why) for id in campaigns]
        sent += [self._stops.submit(self._lab.endurance(id).stop, reason=why) for id in tests]
        self._did(
            who, f"Stop of {rig}" + (f": {reason}" if reason else "."), campaigns=campaigns, endurance_tests=tests
        )
        done, pending = wait(sent, timeout=ANSWER_SECONDS)
        for future in pending:
            future.add_done_callback(partial(self._tell_failure, attempt))
        for future in done:
            future.result()
        return {"rig": rig, "rests": not pending, "attempt": attempt}

    def _tell_failure(self, attempt: str, future: Future[Any]) -> None:
        if (error := future.exception()) is not None:
            failure = f"The stop was not carried out: {error} Use the emergency stop."
            self._view.say(failure, trouble=True, attempt=attempt)

    def stop_all(self, who: str, reason: str) -> dict[str, Any]:
        """Stop every rig."""
        attempt = secrets.token_hex(8)
        answers = [self._stops.submit(self.stop, rig, who, reason, attempt) for rig in self._lab.rig_names()]
        return {"rig": "", "rests": all(answer.result()["rests"] for answer in answers), "attempt": attempt}

    def reset(self, rig: str, who: str, reason: str) -> dict[str, Any]:
        """Clear the latch of a rig."""
        self._require_known(rig)
        self._holders.require(who, rig)
        self._did(who, f"Reset of {rig}: {reason}")
        state = self._lab.reset(rig, name=who, reason=reason)
        return {"mode": state.mode.value}

    def take(self, rig: str, who: str) -> dict[str, Any]:
        """Take a rig over from its present holder."""
        self._require_known(rig)
        before = self._holders.take(rig, who)
        from_whom = f" from {before.name}" if before is not None and before.name != who else ""
        self._did(who, f"{who} holds the rig {rig} now, taken over{from_whom}.")
        return {"holder": who}

    def release(self, rig: str, who: str) -> dict[str, Any]:
        """Release a rig."""
        if self._holders.release(rig, who):
            self._did(who, f"{who} no longer holds the rig {rig}.")
        return {}

    def _require_known(self, rig: str) -> None:
        if rig not in (known := self._lab.rig_names()):
            raise InputError(f"There is no rig {rig!r}; there are {', '.join(known) or 'none'}.", field="rig")

    def campaign(self, kind: str, name: str) -> Campaign:
        """Return a shipped campaign, or one of a file of the page's folder."""
        return load_campaign(name if kind == "shipped" else self.folder / f"{name}.yaml")

    def begin(self, values: Begin, who: str) -> dict[str, Any]:
        """Begin a campaign; it continues without the page."""
        if values.kind == "shipped" and values.name not in (shipped := shipped_campaigns()):
            raise InputError(f"There is no shipped campaign {values.name!r}; there are {', '.join(shipped)}.")
        plan = self.campaign(values.kind, values.name)
        folder = Path() if values.kind == "shipped" else self.folder
        plan = plan.read_from(folder=folder, text=f"# Begun at the operator page by {who}.\n{plan.text}")
        if missing := missing_target(plan, place=PLACES[values.kind]):
            raise InputError(f"{plan.name} cannot begin. {missing}", field="name")
        _require_shown(values.rigs, plan.rigs)
        for rig in plan.rigs:
            self._require_known(rig)

        def work(cancel: threading.Event) -> str:
            id = self._lab.begin(
                plan, on_progress=lambda done: self._view.wait_with(plan.rig, done.activity), cancel=cancel
            )
            return f"The campaign {id} has begun."

        attempt = self._make_ready(plan.rigs, "making the target", work, who=who)
        self._did(who, f"Begin of campaign {plan.name} on {plan.rig}.")
        return {"rig": plan.rig, "campaign": plan.name, "attempt": attempt}

    def _make_ready(
        self, rigs: Sequence[str], activity: str, begin: Callable[[threading.Event], str], *, who: str
    ) -> str:
        """Hold rigs and start something on them in the background; return its attempt.

        A stop of one of them sets the event, which interrupts it.
        """
        cancel, key = threading.Event(), " ".join(rigs)
        with self._lock:
            if taken := [rig for name in self._beginning for rig in name.split() if rig in rigs]:
                raise InputError(f"A test is already being made ready on {taken[0]}; wait, or stop it.")
            taken = self._holders.require(who, *rigs)
            self._beginning[key] = cancel

        def work() -> str:
            try:
                self._view.wait_with(rigs[0], activity)
                return begin(cancel)
            finally:
                with self._lock:
                    del self._beginning[key]
                self._view.wait_with(rigs[0], "")

        return self._in_background(work, name="page-begin", who=who, taken=taken)

    def pre_test(self, rig: str, who: str, level: float) -> dict[str, Any]:
        """Play small pulses on each drive of a rig and report faults; it continues without the page.

        `level`: Share of the limits.
        """
        self._require_known(rig)
        self._holders.require(who, rig)
        self._did(who, f"Pre-test of {rig} at {100.0 * level:g} % of its limits.")

        def work() -> str:
            found = self._lab.pre_test(rig, level=level)
            for finding in found.findings:
                self._view.say(f"Pre-test of {rig}: {finding.sentence}", trouble=finding.failed)
            if not found.passed:
                raise LabError(f"The pre-test of {rig} is not passed.")
            return f"The pre-test of {rig} is passed."

        return {"rig": rig, "attempt": self._in_background(work, name="page-pre-test", who=who)}

    def stop_campaign(self, id: str, who: str, reason: str) -> dict[str, Any]:
        """Stop a campaign and the rig it uses."""
        if rig := self._view.rig_of(id):
            return self.stop(rig, who, reason)
        raise InputError(f"There is no campaign {id!r} under way.", field="id")

    def decide(self, id: str, values: Decide, who: str) -> dict[str, Any]:
        """Decide at a hold point."""
        self._holders.require(who, self._rig_of(id))
        progress = self._lab.decide(
            id,
            values.kind,
            proposal=values.proposal,
            name=who,
            reason=values.reason,
            settings=values.settings,
            from_iteration=values.from_iteration,
        )
        self._did(who, f"{id}: {values.kind}, on proposal {values.proposal}: {values.reason}")
        return {"activity": progress.activity}

    def resume(self, id: str, values: Resume, who: str) -> dict[str, Any]:
        """Continue an interrupted campaign, or resume an ended one as a new campaign; it runs without the page."""
        rig = self._rig_of(id)
        self._holders.require(who, rig)
        self._did(who, f"Resume of campaign {id} on {rig}.")
        out = self.folder / "results" / id

        def work() -> str:
            self._lab.resume(id, from_iteration=values.from_iteration, out=out)
            return f"The campaign resumed from {id} has ended."

        return {"rig": rig, "attempt": self._in_background(work, name="page-resume", who=who)}

    def _rig_of(self, id: str) -> str:
        if not (rig := self._view.rig_of(id)):
            raise InputError(f"There is no campaign {id!r} in this lab.", field="id")
        return rig

    # Endurance tests.

    def begin_endurance(self, values: BeginEndurance, who: str) -> dict[str, Any]:
        """Begin an endurance test of a schedule file; it continues without the page."""
        schedule = load_schedule(self.folder / f"{values.name}.yaml")
        _require_shown(values.rigs, (schedule.rig,))
        self._require_known(schedule.rig)

        def work(cancel: threading.Event) -> str:
            complete = fetched_drives(schedule, self._lab.catalogue, self.folder)
            if cancel.is_set():
                raise LabError(f"The endurance test {schedule.name} was stopped before it began.")
            test = self._lab.endure(complete, seed=values.seed, real_time=values.real_time)
            if cancel.is_set():
                test.stop(reason="It was stopped while it began.")
            return f"The endurance test {test.id} has begun."

        attempt = self._make_ready([schedule.rig], "reading the drives of the schedule", work, who=who)
        self._did(who, f"Begin of the endurance test {schedule.name} on {schedule.rig}.")
        return {"rig": schedule.rig, "test": schedule.name, "attempt": attempt}

    def hold_endurance(self, id: str, who: str, reason: str) -> dict[str, Any]:
        """Hold an endurance test after the present repeat."""
        self._holders.require(who, self._view.endurance.progress(id).rig)
        progress = self._lab.endurance(id).hold(reason=f"{reason} ({who}, at the operator page)")
        self._did(who, f"{id}: hold after the repeat that plays: {reason}")
        return {"activity": progress.activity}

    def decide_endurance(self, id: str, values: DecideEndurance, who: str) -> dict[str, Any]:
        """Decide on a hold of an endurance test."""
        self._holders.require(who, self._view.endurance.progress(id).rig)
        progress = self._lab.endurance(id).decide(values.kind, hold=values.hold, name=who, reason=values.reason)
        self._did(who, f"{id}: {values.kind.replace('_', ' ')}, on hold {values.hold}: {values.reason}")
        return {"activity": progress.activity}

    def stop_endurance(self, id: str, who: str, reason: str) -> dict[str, Any]:
        """Stop an endurance test and its rig."""
        return self.stop(self._view.endurance.progress(id).rig, who, reason)

    def resume_endurance(self, id: str, who: str) -> dict[str, Any]:
        """Resume an endurance test whose sequencer ended, at its next repeat."""
        test = self._lab.endurance(id)
        self._holders.require(who, test.rig)
        progress = test.resume()
        self._did(who, f"Resume of the endurance test {id} on {test.rig}.")
        return {"rig": test.rig, "activity": progress.activity}


def _require_shown(shown: Sequence[str] | None, rigs: Sequence[str]) -> None:
    """Require that a file needs the rigs that the page showed, if the page showed any."""
    if shown is not None and list(shown) != list(rigs):
        raise InputError(
            f"The file was changed: it needs {' and '.join(rigs)}, not {' and '.join(shown)}; choose it again.",
            field="rigs",
        )
