"""Endpoints of the screen Recordings: search, verify, report, compare, export."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from starlette.responses import Response

from duralab.lab import Lab, Result
from operator_page.accounts import PageRole
from operator_page.documents import recording_document
from operator_page.endpoints import Asked, Endpoint, RefusedError, Workers
from operator_page.files import SUFFIXES
from operator_page.requests import Nothing

MOST_RECORDINGS: Final = 500
MOST_COMPARED: Final = 6

# Policy of a report: only its embedded scripts and styles, in a separate origin.
REPORT_POLICY: Final = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; frame-ancestors 'none'"
)


class RecordingRoutes:
    """Endpoints for the recorder's recordings."""

    def __init__(self, lab: Lab, workers: Workers) -> None:
        self._lab, self._workers = lab, workers

    def endpoints(self) -> tuple[Endpoint, ...]:
        """Return the endpoints of the screen."""
        viewer = PageRole.VIEWER
        return (
            Endpoint("/api/recordings", viewer, self._recordings),
            Endpoint("/api/recordings/{id}/report", viewer, self._report),
            Endpoint("/api/recordings/{id}/export/{what}/{suffix}", viewer, self._export),
            Endpoint("/api/comparison", viewer, self._comparison),
            Endpoint("/api/recordings/{id}/verify", PageRole.OPERATOR, self._verify, Nothing),
        )

    async def _recordings(self, asked: Asked) -> Mapping[str, Any]:
        given = {name: asked.request.query_params.get(name, "") for name in ("rig", "target", "result")}
        catalogue = self._lab.catalogue
        found = await self._workers.in_thread(
            lambda: catalogue.search(rig=given["rig"], target=given["target"], result=given["result"] or None)
        )
        newest = list(reversed(found))[:MOST_RECORDINGS]
        return {
            "recordings": [recording_document(each) for each in newest],
            "found": len(found),
            "results": list(Result),
        }

    async def _verify(self, asked: Asked) -> Mapping[str, Any]:
        return {"findings": await self._workers.in_thread(self._lab.catalogue.verify, asked.named("id"))}

    async def _report(self, asked: Asked) -> Response:
        return await self._made([asked.named("id")], "report", "report.html")

    async def _comparison(self, asked: Asked) -> Response:
        ids = asked.request.query_params.getlist("id")
        if not 2 <= len(ids) <= MOST_COMPARED:
            raise RefusedError(400, f"{len(ids)} recordings are given; give 2 to {MOST_COMPARED} to compare.")
        return await self._made(ids, "compare", "comparison.html")

    async def _export(self, asked: Asked) -> Response:
        what, suffix = asked.named("what"), asked.named("suffix")
        if what not in ("target", "drive", "response") or f".{suffix}" not in SUFFIXES:
            raise RefusedError(404, "There is no such export.")
        return await self._made([asked.named("id")], "export", f"{what}.{suffix}", what)

    async def _made(self, ids: list[str], job: str, name: str, *values: Any) -> Response:
        """Fetch recordings, run a job on them, and send the result; nothing of it is stored here."""
        passing = await self._workers.in_thread(
            partial(tempfile.TemporaryDirectory, prefix="duralab-page-", ignore_cleanup_errors=True)
        )
        try:
            folder = Path(passing.name)
            fetched = [
                await self._workers.in_thread(self._lab.catalogue.fetch, id, folder / str(number))
                for number, id in enumerate(ids)
            ]
            await self._workers.in_child(job, fetched if job == "compare" else fetched[0], *values, folder / name)
            content = await self._workers.in_thread((folder / name).read_bytes)
        finally:
            await self._workers.in_thread(passing.cleanup)
        if name.endswith(".html"):
            # It runs its own scripts, separated from this page: it can neither read nor send anything.
            return Response(content, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})
        disposition = f'attachment; filename="{ids[0]}.{name}"'
        return Response(content, media_type="application/octet-stream", headers={"content-disposition": disposition})
