"""Endpoints of the screen New test: campaign files, measured files, and a target before and after its editing."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from duralab import Campaign, InputError, LabError, Rig
from duralab.lab import Lab, Result
from operator_page.accounts import PageRole
from operator_page.endpoints import Asked, Endpoint, RefusedError, Workers
from operator_page.files import PageFiles
from operator_page.lab_view import LabView
from operator_page.requests import CAMPAIGN_NAME, CampaignDocument, Nothing


class FileRoutes:
    """Endpoints for files of the page's folder."""

    def __init__(self, lab: Lab, view: LabView, files: PageFiles, workers: Workers) -> None:
        self._lab, self._view, self._files, self._workers = lab, view, files, workers

    def endpoints(self) -> tuple[Endpoint, ...]:
        """Return the endpoints of the screen."""
        viewer, operator = PageRole.VIEWER, PageRole.OPERATOR
        return (
            Endpoint("/api/campaign_files", viewer, self._campaign_files),
            Endpoint("/api/campaign_files/{kind}/{name}", viewer, self._campaign_file),
            Endpoint("/api/campaign_schema", viewer, self._schema),
            Endpoint("/api/rigs/{rig}/template", viewer, self._template),
            # Requests that cost time or room, without a motion.
            Endpoint("/api/campaign_files", operator, self._check_campaign, CampaignDocument),
            Endpoint("/api/target_preview", operator, self._preview, CampaignDocument),
            Endpoint("/api/pre_test_levels", operator, self._levels, CampaignDocument),
            Endpoint("/api/uploads/{name}", operator, self._upload, Nothing, raw=True),
        )

    async def _campaign_files(self, _asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._files.listed)

    async def _campaign_file(self, asked: Asked) -> Mapping[str, Any]:
        kind, name = asked.named("kind"), asked.named("name")
        if kind not in ("shipped", "file") or not re.fullmatch(CAMPAIGN_NAME, name):
            raise RefusedError(404, f"There is no campaign {name!r} on this page.")
        return {"document": await self._workers.in_thread(self._files.document, kind, name)}

    async def _schema(self, _asked: Asked) -> Mapping[str, Any]:
        return Campaign.model_json_schema()

    async def _template(self, asked: Asked) -> Mapping[str, Any]:
        rig = await self._workers.in_thread(self._lab.describe, asked.named("rig"))
        return {"document": await self._workers.in_thread(self._files.template, rig)}

    async def _checked_campaign(self, asked: Asked) -> tuple[Campaign, str, Rig | None]:
        document = asked.values.document
        name = document.get("rig")
        there = isinstance(name, str) and name in self._lab.rig_names()
        rig = await self._workers.in_thread(self._lab.describe, name) if there else None
        plan, text = await self._workers.in_thread(self._files.checked, document, rig)
        return plan, text, rig

    async def _check_campaign(self, asked: Asked) -> Mapping[str, Any]:
        plan, text, rig = await self._checked_campaign(asked)
        if asked.values.save:
            await self._workers.in_thread(partial(self._files.save, plan, text, replace=asked.values.replace))
            self._view.say(f"The campaign file {plan.name} is saved.", who=asked.who)
        return {"text": text, "remarks": plan.remarks, "rig_is_here": rig is not None}

    async def _campaign_of_a_rig(self, asked: Asked) -> tuple[str, Rig]:
        plan, text, rig = await self._checked_campaign(asked)
        if rig is None:
            raise RefusedError(400, f"There is no rig {plan.rig!r} in this lab, so that its channels are not known.")
        return text, rig

    async def _preview(self, asked: Asked) -> Mapping[str, Any]:
        text, rig = await self._campaign_of_a_rig(asked)
        return await self._workers.in_child("target", text, self._files.folder, rig)

    async def _levels(self, asked: Asked) -> Mapping[str, Any]:
        text, rig = await self._campaign_of_a_rig(asked)
        with tempfile.TemporaryDirectory() as folder:
            recording = await self._workers.in_thread(self._newest_pre_test, rig.name, Path(folder))
            return await self._workers.in_child("levels", text, self._files.folder, rig, recording)

    def _newest_pre_test(self, rig: str, folder: Path) -> Path:
        """Copy the newest passed pre-test of a rig to a folder; return the path of its recording."""
        found = self._lab.catalogue.search(rig=rig, result=Result.PRE_TEST_PASSED)
        if not found:
            raise InputError(f"There is no passed pre-test of {rig} in this lab; make one on the screen Rig.")
        return self._lab.catalogue.fetch(found[-1].id, folder / "pre_test")

    async def _upload(self, asked: Asked) -> Mapping[str, Any]:
        kept = await self._files.upload(asked.named("name"), asked.request.stream())
        path = self._files.folder / kept
        try:
            found = await self._workers.in_child("read", path)
        except LabError:
            path.unlink(missing_ok=True)
            raise
        self._view.say(f"The file {kept} was put on this page.", who=asked.who)
        return {"file": kept, **found}
