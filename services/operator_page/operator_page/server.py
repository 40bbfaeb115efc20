"""The page over HTTP: roles, and checks of every request before it is processed."""

from __future__ import annotations

import asyncio
import hashlib
import json
import time
from collections.abc import AsyncIterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.resources import files
from typing import Any, Final
from urllib.parse import urlsplit

import structlog
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from duralab import BusyError, InputError, LabError, LabTimeoutError, NotReadyError, StoppedError, UnavailableError
from duralab.lab import Lab
from duralab_bus import BusError
from duralab_settings import explain_validation
from operator_page.accounts import Accounts, PageRole
from operator_page.campaign_routes import CampaignRoutes
from operator_page.certificates import peer_certificate
from operator_page.commands import Commands
from operator_page.config import PageConfig
from operator_page.deliberation import OLDEST_SECONDS, Arming
from operator_page.documents import rig_document
from operator_page.endpoints import Asked, Endpoint, RefusedError, Workers, error_answer, json_body
from operator_page.endurance_routes import EnduranceRoutes
from operator_page.file_routes import FileRoutes
from operator_page.files import PageFiles
from operator_page.lab_view import LabView
from operator_page.recording_routes import RecordingRoutes
from operator_page.requests import Arm, Nothing, PreTest, Reset, SignIn, Stop
from operator_page.sessions import RateLimit, Session, Sessions
from operator_page.shell import Shell

COOKIE: Final = "duralab_session"
TOKEN_HEADER: Final = "x-duralab-token"
VERSION_HEADER: Final = "x-duralab-page"
MOST_STREAMS: Final = 64
STREAM_SECONDS: Final = 0.2
HEARTBEAT_SECONDS: Final = 1.0
LOCAL_OPERATOR: Final = "local operator"

_TYPES: Final = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
# Files that every page needs, sent as one: each request delays the opening of a page by a few milliseconds.
_JOINED: Final = {
    "vendor.js": (("preact.js", "preact-hooks.js", "htm.js", "uplot.js"), b"\n;\n"),
    "page.css": (("uplot.css", "style.css"), b"\n"),
}
_STATUS: Final = (
    (InputError, 400),
    (BusyError, 409),
    (NotReadyError, 409),
    (StoppedError, 409),
    (UnavailableError, 503),
    (LabTimeoutError, 504),
)


class PageServer:
    """Endpoints of the page; `app` is the application for a web server."""

    def __init__(
        self,
        *,
        lab: Lab,
        view: LabView,
        commands: Commands,
        config: PageConfig,
        accounts: Accounts | None,
    ) -> None:
        self._lab, self._view, self._commands = lab, view, commands
        self._config, self._accounts = config, accounts
        self._log = structlog.get_logger("operator_page")
        self._workers = Workers()
        kept = PageFiles(config.folder, largest_bytes=config.largest_upload_mebibytes * 2**20)
        self._screens = (
            FileRoutes(lab, view, kept, self._workers),
            CampaignRoutes(lab, commands, self._workers),
            EnduranceRoutes(lab, view, commands, kept, self._workers),
            RecordingRoutes(lab, self._workers),
        )
        self._passwords = ThreadPoolExecutor(2, thread_name_prefix="page-password")
        self.sessions = Sessions(config.session_hours * 3600.0)
        self._arming = Arming()
        self._calls = RateLimit(100, 50)
        # Five wrong passwords of a name, or twenty from an address, then one every half minute.
        self._failures, self._failures_from = RateLimit(5, 1 / 30), RateLimit(20, 1 / 30)
        self.streams = 0
        self.closing = False
        self._web = {entry.name: entry.read_bytes() for folder in ("web", "web/vendor") for entry in _files(folder)}
        for name, (parts, between) in _JOINED.items():
            self._web[name] = between.join(self._web.pop(part) for part in parts)
        self.version = hashlib.sha256(b"".join(v for _, v in sorted(self._web.items()))).hexdigest()[:12]
        self._index = self._web["index.html"].replace(b"{{version}}", self.version.encode())
        self.endpoints = self._endpoints()
        routes = [Route("/", self._page), Route("/web/{name}", self._file)]
        routes += [Route(each.path, partial(self._guarded, each), methods=[each.method]) for each in self.endpoints]
        self.app: ASGIApp = Shell(Starlette(routes=routes), self._is_own_name, config)

    def _endpoints(self) -> tuple[Endpoint, ...]:
        viewer, operator = PageRole.VIEWER, PageRole.OPERATOR
        return (
            Endpoint("/api/session", None, self._session),
            Endpoint("/api/sign_in", None, self._sign_in, SignIn),
            Endpoint("/api/sign_in_by_certificate", None, self._sign_in_by_certificate, Nothing),
            Endpoint("/api/sign_out", viewer, self._sign_out, Nothing),
            Endpoint("/api/stream", viewer, self._stream),
            Endpoint("/api/rigs/{rig}", viewer, self._describe),
            # Every operator may stop every rig, at any time, as on the bus.
            Endpoint("/api/stop", operator, self._stop_all, Stop, unlimited=True),
            Endpoint("/api/rigs/{rig}/stop", operator, self._stop, Stop, unlimited=True),
            Endpoint("/api/arm", operator, self._arm, Arm),
            Endpoint("/api/rigs/{rig}/take", operator, self._take, Nothing, armed=True),
            Endpoint("/api/rigs/{rig}/release", operator, self._release, Nothing),
            Endpoint("/api/rigs/{rig}/reset", operator, self._reset, Reset, armed=True),
            Endpoint("/api/rigs/{rig}/pre_test", operator, self._pre_test, PreTest, armed=True),
            *(endpoint for screen in self._screens for endpoint in screen.endpoints()),
        )

    # Checks of every request.

    def _is_own_name(self, host: str) -> bool:
        """Return whether a browser used one of the page's names, so that no other site's name can lead here."""
        try:
            name = urlsplit(f"//{host}").hostname
        except ValueError:
            return False
        return name in {self._config.host, "localhost", *self._config.names}

    async def _guarded(self, endpoint: Endpoint, request: Request) -> Response:
        try:
            answer = await endpoint.answer(await self._checked(endpoint, request))
        except RefusedError as refusal:
            return error_answer(refusal.status, str(refusal), field=refusal.field)
        except PermissionError as error:
            return error_answer(409, str(error), field="holder")
        except LabError as error:
            status = next((status for kind, status in _STATUS if isinstance(error, kind)), 502)
            return error_answer(status, error.message, field=error.field)
        except BusError as error:
            return error_answer(503, str(error))
        return answer if isinstance(answer, Response) else JSONResponse(answer)

    async def _checked(self, endpoint: Endpoint, request: Request) -> Asked:
        session = self.sessions.find(request.cookies.get(COOKIE, ""))
        if session is not None and session.certificate:
            shown = peer_certificate(request)
            if shown is None or shown.name != session.certificate:
                session = None
        if endpoint.role is not None:
            if session is None:
                raise RefusedError(401, "You are not signed in, or too long ago; sign in.")
            if endpoint.role is PageRole.OPERATOR and session.role is not PageRole.OPERATOR:
                raise RefusedError(403, f"{session.name} is a viewer; ask an operator to do this.")
        caller = session.token if session is not None else request.client.host if request.client else ""
        if not endpoint.unlimited and not self._calls.allows(caller):
            raise RefusedError(429, "Too many requests; wait a second.")
        if endpoint.values is None:
            return Asked(request, session, None)
        self._require_own_page(request, session)
        if endpoint.raw:
            return Asked(request, session, None)
        body = await json_body(request)
        seen, word = body.pop("seen", None), body.pop("word", "")
        try:
            values = endpoint.values.model_validate(body)
        except ValidationError as error:
            found = explain_validation(error, endpoint.values)
            raise RefusedError(400, found.sentence, field=found.field) from error
        if (endpoint.armed or endpoint.values is Arm) and session is not None:
            self._require_fresh(seen)
            if endpoint.armed and not (
                isinstance(word, str) and self._arming.use(word, session.token, request.url.path, body)
            ):
                raise RefusedError(428, "This needs two acts, the second within 10 s of the first; begin again.")
        return Asked(request, session, values)

    def _require_own_page(self, request: Request, session: Session | None) -> None:
        origin = request.headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != request.headers.get("host"):
            raise RefusedError(403, "The request comes from another site; use the page itself.")
        if session is not None and not session.is_own(request.headers.get(TOKEN_HEADER, "")):
            raise RefusedError(403, "The request does not come from a page of this session; reload the page.")
        if request.headers.get(VERSION_HEADER) != self.version:
            raise RefusedError(409, "The page is of another version than its service; reload it.", field="version")

    @staticmethod
    def _require_fresh(seen: object) -> None:
        age = time.time() - seen if isinstance(seen, int | float) and not isinstance(seen, bool) else float("inf")
        # The time comes from this process: a later time cannot have been seen.
        if not -0.5 <= age <= OLDEST_SECONDS:
            raise RefusedError(
                409, "The page shows old data, so that nothing may move; wait for new ones.", field="seen"
            )

    # The page and its files.

    async def _page(self, _request: Request) -> Response:
        return Response(self._index, media_type="text/html")

    async def _file(self, request: Request) -> Response:
        name = request.path_params["name"]
        if (content := self._web.get(name)) is None or name == "index.html":
            return error_answer(404, "There is no such file.")
        return Response(content, media_type=_TYPES.get(name.rpartition(".")[2], "text/plain"))

    # Signing in.

    async def _session(self, asked: Asked) -> Response:
        session = asked.session
        if session is None and self._accounts is None:
            cookie, session = self.sessions.begin(LOCAL_OPERATOR, PageRole.OPERATOR)
            return self._with_cookie(cookie, session)
        shown = peer_certificate(asked.request)
        certificate = {"certificate": shown.name} if session is None and shown is not None else {}
        return JSONResponse(self._session_document(session) | certificate)

    def _session_document(self, session: Session | None) -> dict[str, Any]:
        who = {} if session is None else {"name": session.name, "role": session.role.value, "token": session.token}
        return {"version": self.version, "accounts": self._accounts is not None, "viewer": self._config.viewer, **who}

    def _with_cookie(self, cookie: str, session: Session) -> Response:
        answer = JSONResponse(self._session_document(session))
        secure = self._config.tls is not None
        answer.set_cookie(COOKIE, cookie, httponly=True, samesite="strict", secure=secure)
        return answer

    async def _sign_in(self, asked: Asked) -> Response:
        values: SignIn = asked.values
        address = asked.request.client.host if asked.request.client else ""
        if self._accounts is None:
            raise RefusedError(409, "This page has no accounts; reload it.")
        if not (self._failures.allows(values.name, cost=0) and self._failures_from.allows(address, cost=0)):
            raise RefusedError(429, "Too many wrong passwords; wait half a minute.")
        loop = asyncio.get_running_loop()
        role = await loop.run_in_executor(self._passwords, self._accounts.role_of, values.name, values.password)
        if role is None:
            self._failures.allows(values.name)
            self._failures_from.allows(address)
            self._log.warning("sign-in refused", who=values.name, address=address)
            raise RefusedError(401, "Name or password is wrong.")
        return self._signed_in(asked, values.name, role)

    async def _sign_in_by_certificate(self, asked: Asked) -> Response:
        shown = peer_certificate(asked.request)
        if shown is None:
            raise RefusedError(401, "Your browser showed no certificate of this lab; choose one, or give a password.")
        name = self._accounts.certificates.get(shown.name) if self._accounts is not None else None
        if self._accounts is None or name is None or shown.seconds_left <= 0.0:
            why = "has expired" if shown.seconds_left <= 0.0 else "belongs to no account of this page"
            self._log.warning("sign-in refused", certificate=shown.name, reason=why)
            raise RefusedError(401, f"The certificate {shown.name!r} {why}; choose another one, or give a password.")
        role = self._accounts.accounts[name].role
        # The session ends with its certificate.
        return self._signed_in(asked, name, role, certificate=shown.name, seconds=shown.seconds_left)

    def _signed_in(self, asked: Asked, name: str, role: PageRole, **how: Any) -> Response:
        if old := asked.request.cookies.get(COOKIE):
            self.sessions.end(old)
        cookie, session = self.sessions.begin(name, role, **how)
        address = asked.request.client.host if asked.request.client else ""
        self._log.info("signed in", who=name, role=role.value, address=address, certificate=session.certificate)
        return self._with_cookie(cookie, session)

    async def _sign_out(self, asked: Asked) -> Response:
        self.sessions.end(asked.request.cookies.get(COOKIE, ""))
        answer = JSONResponse({})
        answer.delete_cookie(COOKIE)
        return answer

    # State of the lab.

    async def _stream(self, asked: Asked) -> Response:
        if self.streams >= MOST_STREAMS:
            raise RefusedError(429, f"{MOST_STREAMS} pages are open already; close one.")
        cookie = asked.request.cookies.get(COOKIE, "")
        return StreamingResponse(self._events(cookie), media_type="text/event-stream")

    async def _events(self, cookie: str) -> AsyncIterator[bytes]:
        self.streams += 1
        try:
            seen: dict[str, tuple[int, int, int]] = {}
            line, shown, sent = 0, -1, 0.0
            yield b"retry: 1000\n\n"
            while not self.closing:
                if self.sessions.find(cookie) is None:
                    yield _event("ended", {})
                    return
                now = time.monotonic()
                if self._view.changes != shown or now - sent >= HEARTBEAT_SECONDS:
                    shown, sent = self._view.changes, now
                    document = await self._workers.in_thread(partial(self._view.document, after_line=line))
                    line = document["log"][-1]["number"] if document["log"] else line
                    yield _event("lab", {"version": self.version, **document})
                for part in await self._workers.in_thread(self._view.signals, seen):
                    yield _event("signals", part)
                await asyncio.sleep(STREAM_SECONDS)
        finally:
            self.streams -= 1

    # State of a rig and a campaign.

    async def _describe(self, asked: Asked) -> Mapping[str, Any]:
        return rig_document(await self._workers.in_thread(self._lab.describe, asked.named("rig")))

    # Commands.

    async def _arm(self, asked: Asked) -> Mapping[str, Any]:
        if asked.session is None:
            raise RefusedError(401, "You are not signed in.")
        return {"word": self._arming.arm(asked.session.token, asked.values.action, asked.values.values)}

    async def _stop_all(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._commands.stop_all, asked.who, asked.values.reason)

    async def _stop(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._commands.stop, asked.named("rig"), asked.who, asked.values.reason)

    async def _take(self, asked: Asked) -> Mapping[str, Any]:
        return self._commands.take(asked.named("rig"), asked.who)

    async def _release(self, asked: Asked) -> Mapping[str, Any]:
        return self._commands.release(asked.named("rig"), asked.who)

    async def _reset(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._commands.reset, asked.named("rig"), asked.who, asked.values.reason)

    async def _pre_test(self, asked: Asked) -> Mapping[str, Any]:
        return await self._workers.in_thread(self._commands.pre_test, asked.named("rig"), asked.who, asked.values.level)


def _files(folder: str) -> list[Any]:
    return [entry for entry in (files("operator_page") / folder).iterdir() if entry.is_file()]


def _event(kind: str, document: Mapping[str, Any]) -> bytes:
    return f"event: {kind}\ndata: {json.dumps(document, allow_nan=False)}\n\n".encode()
