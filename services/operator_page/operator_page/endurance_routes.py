"""Endpoints of the screen Endurance: schedules; start, display, hold, decision and stop of endurance tests."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from functools import partial
from typing import Any

from duralab import CatalogueEntry
from duralab.lab import Lab
from operator_page.accounts import PageRole
from operator_page.commands import Commands
from operator_page.endpoints import Asked, Endpoint, RefusedError, Workers
from operator_page.files import PageFiles, fetched_drives
from operator_page.lab_view import LabView
from operator_page.requests import BeginEndurance, DecideEndurance, Nothing, ScheduleDocument, StopEndurance


def _is_test(entry: CatalogueEntry) -> bool:
    """Return whether a recording is one of an endurance test, by the target's name that the recorder gives it."""
    return entry.target.startswith("endurance test ")


class EnduranceRoutes:
    """Endpoints for endurance tests."""

    def __init__(self, lab: Lab, view: LabView, commands: Commands, files: PageFiles, workers: Workers) -> None:
        self._lab, self._view, self._commands, self._files, self._workers = lab, view, commands, files, workers

    def endpoints(self) -> tuple[Endpoint, ...]:
        """Return the endpoints of the screen."""
        viewer, operator = PageRole.VIEWER, PageRole.OPERATOR
        return (
            Endpoint("/api/schedules", viewer, self._schedules),
            Endpoint("/api/schedules/{name}", operator, self._schedule),
            Endpoint("/api/schedules", operator, self._check, ScheduleDocument),
            Endpoint("/api/endurance/{id}", viewer, self._details),
            Endpoint("/api/endurance", operator, self._begin, BeginEndurance, armed=True),
            Endpoint("/api/endurance/{id}/hold", operator, self._hold, StopEndurance, armed=True),
            Endpoint("/api/endurance/{id}/decide", operator, self._decide, DecideEndurance, armed=True),
            Endpoint("/api/endurance/{id}/stop", operator, self._stop, StopEndurance, armed=True),
            Endpoint("/api/endurance/{id}/resume", operator, self._resume, Nothing, armed=True),
        )

    async def _schedules(self, _asked: Asked) -> Mapping[str, Any]:
        """List schedule files, recordings with a drive, and interrupted tests."""
        found = await self._workers.in_thread(self._lab.catalogue.search)
        shown = self._view.endurance.documents(time.time())
        under_way = {each["id"] for each in shown if not (each["ended"] or each["silent"])}
        open_ones = {re.sub(r"-v\d{4}$", "", each.id) for each in found if _is_test(each) and not each.closed}
        listed = await self._workers.in_thread(self._files.listed)
        return {
            "schedules": listed["schedules"],
            "schedule_rigs": listed["schedule_rigs"],
            "drives": [
                {"id": each.id, "rig": each.rig, "result": each.result.value}
                for each in found
                if each.target and each.closed and not _is_test(each)
            ],
            "open": sorted(open_ones - under_way),
        }

    async def _schedule(self, asked: Asked) -> Mapping[str, Any]:
        """Return the forecast of a schedule file."""
        name = asked.named("name")
        if name not in (await self._workers.in_thread(self._files.listed))["schedules"]:
            raise RefusedError(404, f"There is no schedule {name!r} on this page.")
        return await self._forecast(self._files.path(name).read_text(encoding="utf-8"))

    async def _check(self, asked: Asked) -> Mapping[str, Any]:
        schedule, text = await self._workers.in_thread(self._files.checked_schedule, asked.values.document)
        if asked.values.save:
            # Before the forecast, which takes seconds.
            self._files.require_free(schedule.name, replace=asked.values.replace)
        found = await self._forecast(text)
        if asked.values.save:
            await self._workers.in_thread(partial(self._files.save, schedule, text, replace=asked.values.replace))
            self._view.say(f"The schedule {schedule.name} is saved.", who=asked.who)
        return {"text": text, **found}

    async def _forecast(self, text: str) -> dict[str, Any]:
        schedule = await self._workers.in_thread(self._files.read_schedule, text)
        complete = await self._workers.in_thread(fetched_drives, schedule, self._lab.catalogue, self._files.folder)
        return await self._workers.in_child("forecast", complete)

    async def _details(self, asked: Asked) -> Mapping[str, Any]:
        given = {name: asked.request.query_params.get(name, "") for name in ("event", "statistic")}
        return await self._workers.in_thread(partial(self._view.endurance.details, asked.named("id"), **given))

    async def _begin(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._commands.begin_endurance, asked.values, asked.who)

    async def _hold(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(
            self._commands.hold_endurance, asked.named("id"), asked.who, asked.values.reason
        )

    async def _decide(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(
            self._commands.decide_endurance, asked.named("id"), asked.values, asked.who
        )

    async def _stop(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(
            self._commands.stop_endurance, asked.named("id"), asked.who, asked.values.reason
        )

    async def _resume(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._commands.resume_endurance, asked.named("id"), asked.who)
