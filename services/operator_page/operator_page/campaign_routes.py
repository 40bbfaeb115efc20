"""Endpoints of the screen Run: start of a campaign, its target, its hold points, decisions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from duralab.lab import Lab
from operator_page.accounts import PageRole
from operator_page.commands import Commands
from operator_page.documents import proposal_curves, proposal_document, target_document
from operator_page.endpoints import Asked, Endpoint, Workers
from operator_page.requests import Begin, Decide, Resume, Stop


class CampaignRoutes:
    """Endpoints for campaigns."""

    def __init__(self, lab: Lab, commands: Commands, workers: Workers) -> None:
        self._lab, self._commands, self._workers = lab, commands, workers

    def endpoints(self) -> tuple[Endpoint, ...]:
        """Return the endpoints of the screen."""
        viewer, operator = PageRole.VIEWER, PageRole.OPERATOR
        return (
            Endpoint("/api/campaigns/{id}/target", viewer, self._target),
            Endpoint("/api/campaigns/{id}/proposal", viewer, self._proposal),
            Endpoint("/api/campaigns/{id}/stop", operator, self._stop_campaign, Stop, unlimited=True),
            Endpoint("/api/campaigns", operator, self._begin, Begin, armed=True),
            Endpoint("/api/campaigns/{id}/decide", operator, self._decide, Decide, armed=True),
            Endpoint("/api/campaigns/{id}/resume", operator, self._resume, Resume, armed=True),
        )

    async def _target(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(lambda: target_document(self._lab.catalogue.target(asked.named("id"))))

    async def _proposal(self, asked: Asked) -> Mapping[str, Any]:
        id = asked.named("id")
        found = await self._workers.in_thread(self._lab.proposal, id)
        if found is None:
            return {"proposal": None}
        last = await self._workers.in_thread(self._lab.last_drive, id, found.follows)
        return {"proposal": proposal_document(found), **await self._workers.in_thread(proposal_curves, found, last)}

    async def _stop_campaign(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(
            self._commands.stop_campaign, asked.named("id"), asked.who, asked.values.reason
        )

    async def _begin(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._commands.begin, asked.values, asked.who)

    async def _decide(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._commands.decide, asked.named("id"), asked.values, asked.who)

    async def _resume(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._commands.resume, asked.named("id"), asked.values, asked.who)
