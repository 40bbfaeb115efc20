"""Correction of an event's drive: which alarms it corrects, and the campaign that makes another drive."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from duralab_bus import Bus, FaultError
from duralab_monitoring import Alarm, Monitor
from duralab_proto.arrays import from_record, to_array, to_record
from duralab_proto.v1 import query_pb2, sequencer_pb2
from sequencer.endurance.iterate_again import (
    AWAY,
    controlled_part,
    corrected_drive,
    limit_of_playbacks,
    playbacks_of,
    wait_for_end,
)
from sequencer.endurance.plan import EndurancePlan
from sequencer.endurance.test_log import EnduranceLog, is_recorded
from sequencer.tally import EventTally


class DriveCorrections:
    """Drives of one endurance test, and the campaigns that correct them; used by the test's thread.

    `tallies`: Tally of each event: the index of its drive, and the playbacks of corrections. `corrected`: Corrected
    drives so far. `monitor`: Monitor of the repeats, whose limits and damage apply to playbacks of corrections, too.
    `stop`: Event that stops a campaign. `on_counted`: Called with the stored count of each correction.
    """

    def __init__(
        self,
        plan: EndurancePlan,
        *,
        bus: Bus,
        log: EnduranceLog,
        tallies: Sequence[EventTally],
        corrected: Sequence[sequencer_pb2.EnduranceDrive],
        monitor: Monitor,
        stop: threading.Event,
        on_counted: Callable[[sequencer_pb2.EnduranceCorrection], None],
    ) -> None:
        self._plan = plan
        self._bus = bus
        self._log = log
        self._tallies = tallies
        self._corrected = list(corrected)
        self._monitor = monitor
        self._stop = stop
        self._on_counted = on_counted
        self.drives = list(plan.drives)
        """Drive in use of each event, shape (drives, samples)."""
        for drive in corrected:
            self.drives[drive.event] = from_record(drive.drive, field="drive")[2]

    @property
    def in_use(self) -> list[sequencer_pb2.EnduranceDrive]:
        """Corrected drives in use."""
        return [drive for drive in self._corrected if self._tallies[drive.event].drive == drive.number]

    def no_repeat_left(self, event: int) -> str:
        """Return that no repeat of an event is left for another drive; empty if one is."""
        if self._tallies[event].played < self._tallies[event].planned:
            return ""
        return f"No repeat of {self._plan.names[event]} is left, so its drive is not corrected."

    def reason_against(self, event: int, alarm: Alarm) -> tuple[Alarm, str]:
        """Return the first alarm that no drive corrects, and why; `alarm` and an empty reason if each may be corrected.

        A correction learns the baseline again of all alarms since the last time, those of earlier repeats and those
        that are only logged, too.
        """
        if no_repeat_left := self.no_repeat_left(event):
            return alarm, no_repeat_left
        parent, name = self._plan.spec.events[event].campaign, self._plan.names[event]
        alarms = self._monitor.standing(name)
        try:
            found = controlled_part(self._bus, parent).uncorrectable(alarms) if parent else []
        except FaultError:
            # The correction reads the same recording, and holds with the fault.
            found = []
        if not found:
            return alarm, ""
        reasons = "; ".join(dict.fromkeys(reason for _, reason in found))
        others = " A correction of the other alarms would learn its baseline again." if len(found) < len(alarms) else ""
        return found[0][0], f"No drive of {name} corrects this alarm: {reasons}.{others}"

    def correct(
        self, event: int, *, response: NDArray[np.float64] | None, on_activity: Callable[[str], None]
    ) -> sequencer_pb2.EnduranceDrive:
        """Give an event another drive, made by a separate campaign; return the stored step.

        `response`: Response of the last repeat of this event, if the rig cannot have been changed since.
        Raises FaultError: Reason why there is no better drive; CANCELLED if the test was stopped.
        """
        parent = self._plan.spec.events[event].campaign
        if not parent:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                "it is from a file and no campaign made it, so neither target nor model are known; make it with a "
                "campaign.",
            )
        number, description = self._tallies[event].drive + 1, self._plan.description
        campaign = self._free_name(event, number)
        # Announced on disk before anything moves: from here on its playbacks count, also after a crash.
        planned = sequencer_pb2.CorrectionPlanned(event=event, campaign=campaign)
        self._log.commit(planned)
        try:
            drive = corrected_drive(
                self._bus,
                self.drives[event],
                response=response,
                parent=parent,
                corrected_by=next((known.campaign for known in reversed(self._corrected) if known.event == event), ""),
                id=campaign,
                description=description,
                playbacks=self._plan.schedule.actions.playbacks,
                passed_limit=self._monitor.passed_abort_limit,
                stop=self._stop,
                on_activity=on_activity,
            )
        finally:
            self.count(planned, on_activity=on_activity)
        message = sequencer_pb2.EnduranceDrive(
            event=event,
            number=number,
            drive=to_record(description.drives, description.sample_rate, drive),
            campaign=campaign,
        )
        self._log.commit(message)
        self._corrected.append(message)
        self.drives[event], self._tallies[event].drive = drive, number
        return message

    def count(self, planned: sequencer_pb2.CorrectionPlanned, *, on_activity: Callable[[str], None]) -> str:
        """Count the playbacks of a campaign once it has ended, from its recording; the stored step counts them once.

        A campaign that still runs, because the sequencer or its connection ended, is stopped at an abort limit. Return
        that limit as a sentence, or nothing.
        """
        limit_of = partial(
            limit_of_playbacks,
            self._bus,
            planned.campaign,
            self._monitor.passed_abort_limit,
            responses=len(self._plan.description.responses),
        )
        passed = wait_for_end(self._bus, planned.campaign, stop=self._stop, on_activity=on_activity, limit_of=limit_of)
        counted = sequencer_pb2.EnduranceCorrection(
            event=planned.event,
            campaign=planned.campaign,
            next_repeat=sum(tally.played for tally in self._tallies),
        )
        tally, damage = self._tallies[planned.event], None
        try:
            playbacks, measured = self._recorded_playbacks(planned.campaign, on_activity)
        except FaultError as fault:
            if fault.code in AWAY:
                raise
            counted.reason = f"The damage of campaign {planned.campaign} is not known and not counted: {fault.message}"
        else:
            counted.playbacks, counted.unknown = playbacks, playbacks - len(measured)
            damage = np.sum([np.zeros_like(tally.damage), *measured], axis=0)
            counted.reason = f"{playbacks} playbacks of campaign {planned.campaign} count with their damage"
            if counted.unknown:
                estimate = tally.damage_per_repeat
                how = "no damage is known of it" if estimate is None else "its damage counts as that of such a repeat"
                counted.reason += f"; where an end is not known ({counted.unknown} of them), {how}"
                damage = damage if estimate is None else damage + counted.unknown * estimate
            counted.reason += "."
            counted.damage.CopyFrom(to_array(damage))
        if passed:
            passed = f"In campaign {planned.campaign} {passed}; look at the specimen."
            counted.reason += f" {passed}"
        self._log.commit(counted)
        tally.count_correction(counted.playbacks, damage)
        self._on_counted(counted)
        return passed

    def _recorded_playbacks(
        self, campaign: str, on_activity: Callable[[str], None]
    ) -> tuple[int, list[NDArray[np.float64]]]:
        """Return the announced playbacks of a campaign and the damage of the recorded ones; wait for the recorder."""
        responses = len(self._plan.description.responses)
        while True:
            try:
                return playbacks_of(self._bus, campaign, responses=responses, damage_of=self._monitor.damage)
            except FaultError as fault:
                if fault.code not in AWAY or self._stop.wait(1.0):
                    raise
                on_activity(f"waiting for the recorder: {fault.message}")

    def _free_name(self, event: int, number: int) -> str:
        """Return the id of the next campaign for a drive of an event: one without a recording.

        The recording of a planned correction is then that of its campaign.
        """
        stem = campaign = f"{self._plan.spec.id}-{self._plan.names[event]}-{number}"
        attempt = 1
        while is_recorded(self._bus, campaign):
            attempt += 1
            campaign = f"{stem}-{attempt}"
        return campaign
