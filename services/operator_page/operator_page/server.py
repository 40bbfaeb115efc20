"""The page over HTTP: who may do what, and what every request has to show before it is looked at."""

from __future__ import annotations

import asyncio
import hashlib
import json
import re
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, TypeVar
from urllib.parse import urlsplit

import structlog
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from duralab import (
    BusyError,
    Campaign,
    InputError,
    LabError,
    LabTimeoutError,
    NotReadyError,
    Rig,
    StoppedError,
    UnavailableError,
)
from duralab.lab import Lab, Result
from duralab_bus import BusError
from duralab_settings import explain_validation
from operator_page.accounts import Accounts, PageRole
from operator_page.certificates import peer_certificate
from operator_page.child import work
from operator_page.commands import Commands
from operator_page.config import PageConfig
from operator_page.deliberation import OLDEST_SECONDS, Arming
from operator_page.documents import (
    proposal_document,
    recording_document,
    rig_document,
    signals_document,
    target_document,
)
from operator_page.files import SUFFIXES, PageFiles
from operator_page.lab_view import LabView
from operator_page.requests import (
    CAMPAIGN_NAME,
    Arm,
    Begin,
    CampaignDocument,
    Decide,
    Nothing,
    Reset,
    Resume,
    SignIn,
    Stop,
    Values,
)
from operator_page.sessions import RateLimit, Session, Sessions

COOKIE: Final = "duralab_session"
TOKEN_HEADER: Final = "x-duralab-token"
VERSION_HEADER: Final = "x-duralab-page"
LARGEST_BODY: Final = 256 * 1024
MOST_STREAMS: Final = 64
STREAM_SECONDS: Final = 0.2
HEARTBEAT_SECONDS: Final = 1.0
MOST_RECORDINGS: Final = 500
MOST_COMPARED: Final = 6
LOCAL_OPERATOR: Final = "local operator"

POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; frame-src {viewer}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# Of a report: scripts and styles that it carries itself, in an origin of its own.
REPORT_POLICY: Final = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; frame-ancestors 'none'"
)
HEADERS: Final = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=(), payment=()",
    "cache-control": "no-store",
}

_TYPES: Final = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
_STATUS: Final = (
    (InputError, 400),
    (BusyError, 409),
    (NotReadyError, 409),
    (StoppedError, 409),
    (UnavailableError, 503),
    (LabTimeoutError, 504),
)
ResultT = TypeVar("ResultT")


class RefusedError(Exception):
    """A request that is not carried out; says why in one sentence."""

    def __init__(self, status: int, sentence: str, *, field: str = "") -> None:
        super().__init__(sentence)
        self.status, self.field = status, field


@dataclass(frozen=True)
class Asked:
    """A request that passed all checks."""

    request: Request
    session: Session | None
    values: Any

    @property
    def who(self) -> str:
        """Name of who asks."""
        return self.session.name if self.session is not None else ""

    def named(self, name: str) -> str:
        """Return a name in the path."""
        return str(self.request.path_params[name])


@dataclass(frozen=True)
class Endpoint:
    """One thing that can be asked: by whom, with which values, and whether it needs a second act.

    `role`: The least one; None for everybody who reaches the page. `values`: None for what is only read. `raw`: Its
    body is a file.
    """

    path: str
    role: PageRole | None
    answer: Callable[[Asked], Awaitable[Response | Mapping[str, Any]]]
    values: type[Values] | None = None
    armed: bool = False
    unlimited: bool = False
    raw: bool = False

    @property
    def method(self) -> str:
        """GET reads, POST does."""
        return "GET" if self.values is None else "POST"


class PageServer:
    """The page's answers; `app` is what a web server runs."""

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
        self._threads = ThreadPoolExecutor(32, thread_name_prefix="page")
        self._files = PageFiles(config.folder, largest_bytes=config.largest_upload_mebibytes * 2**20)
        self._children = ThreadPoolExecutor(2, thread_name_prefix="page-child")
        self._passwords = ThreadPoolExecutor(2, thread_name_prefix="page-password")
        self.sessions = Sessions(config.session_hours * 3600.0)
        self._arming = Arming()
        self._calls = RateLimit(100, 50)
        # Five wrong passwords of a name, or twenty from an address, then one every half minute.
        self._failures, self._failures_from = RateLimit(5, 1 / 30), RateLimit(20, 1 / 30)
        self.streams = 0
        self.closing = False
        self._web = {entry.name: entry.read_bytes() for folder in ("web", "web/vendor") for entry in _files(folder)}
        self.version = hashlib.sha256(b"".join(v for _, v in sorted(self._web.items()))).hexdigest()[:12]
        self._index = self._web["index.html"].replace(b"{{version}}", self.version.encode())
        self.endpoints = self._endpoints()
        routes = [Route("/", self._page), Route("/web/{name}", self._file)]
        routes += [Route(each.path, partial(self._guarded, each), methods=[each.method]) for each in self.endpoints]
        self.app: ASGIApp = _Shell(Starlette(routes=routes), self._is_own_name, config)

    def _endpoints(self) -> tuple[Endpoint, ...]:
        viewer, operator = PageRole.VIEWER, PageRole.OPERATOR
        return (
            Endpoint("/api/session", None, self._session),
            Endpoint("/api/sign_in", None, self._sign_in, SignIn),
            Endpoint("/api/sign_in_by_certificate", None, self._sign_in_by_certificate, Nothing),
            Endpoint("/api/sign_out", viewer, self._sign_out, Nothing),
            Endpoint("/api/stream", viewer, self._stream),
            Endpoint("/api/campaign_files", viewer, self._campaign_files),
            Endpoint("/api/campaign_files/{kind}/{name}", viewer, self._campaign_file),
            Endpoint("/api/campaign_schema", viewer, self._schema),
            Endpoint("/api/rigs/{rig}/template", viewer, self._template),
            Endpoint("/api/recordings", viewer, self._recordings),
            Endpoint("/api/recordings/{id}/report", viewer, self._report),
            Endpoint("/api/recordings/{id}/export/{what}/{suffix}", viewer, self._export),
            Endpoint("/api/comparison", viewer, self._comparison),
            Endpoint("/api/rigs/{rig}", viewer, self._describe),
            Endpoint("/api/campaigns/{id}/target", viewer, self._target),
            Endpoint("/api/campaigns/{id}/proposal", viewer, self._proposal),
            # Every operator may stop every rig, at any time, as on the bus.
            Endpoint("/api/stop", operator, self._stop_all, Stop, unlimited=True),
            Endpoint("/api/rigs/{rig}/stop", operator, self._stop, Stop, unlimited=True),
            Endpoint("/api/campaigns/{id}/stop", operator, self._stop_campaign, Stop, unlimited=True),
            Endpoint("/api/arm", operator, self._arm, Arm),
            # What costs time or room, and moves nothing.
            Endpoint("/api/campaign_files", operator, self._check_campaign, CampaignDocument),
            Endpoint("/api/target_preview", operator, self._preview, CampaignDocument),
            Endpoint("/api/uploads/{name}", operator, self._upload, Nothing, raw=True),
            Endpoint("/api/recordings/{id}/verify", operator, self._verify, Nothing),
            Endpoint("/api/rigs/{rig}/take", operator, self._take, Nothing, armed=True),
            Endpoint("/api/rigs/{rig}/release", operator, self._release, Nothing),
            Endpoint("/api/rigs/{rig}/reset", operator, self._reset, Reset, armed=True),
            Endpoint("/api/rigs/{rig}/pre_test", operator, self._pre_test, Nothing, armed=True),
            Endpoint("/api/campaigns", operator, self._begin, Begin, armed=True),
            Endpoint("/api/campaigns/{id}/decide", operator, self._decide, Decide, armed=True),
            Endpoint("/api/campaigns/{id}/resume", operator, self._resume, Resume, armed=True),
        )

    # What every request has to show.

    def _is_own_name(self, host: str) -> bool:
        """Return whether a browser reached the page by a name of its own: no other site's name may lead here."""
        try:
            name = urlsplit(f"//{host}").hostname
        except ValueError:
            return False
        return name in {self._config.host, "localhost", *self._config.names}

    async def _guarded(self, endpoint: Endpoint, request: Request) -> Response:
        try:
            answer = await endpoint.answer(await self._checked(endpoint, request))
        except RefusedError as refusal:
            return _error(refusal.status, str(refusal), field=refusal.field)
        except PermissionError as error:
            return _error(409, str(error), field="holder")
        except LabError as error:
            status = next((status for kind, status in _STATUS if isinstance(error, kind)), 502)
            return _error(status, error.message, field=error.field)
        except BusError as error:
            return _error(503, str(error))
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
        body = await _body(request)
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
        # Its time comes from this process: none that is still to come was ever seen.
        if not -0.5 <= age <= OLDEST_SECONDS:
            raise RefusedError(
                409, "The page shows old data, so that nothing may move; wait for new ones.", field="seen"
            )

    async def _in_thread(self, work: Callable[..., ResultT], *values: Any) -> ResultT:
        return await asyncio.get_running_loop().run_in_executor(self._threads, work, *values)

    # The page and its files.

    async def _page(self, _request: Request) -> Response:
        return Response(self._index, media_type="text/html")

    async def _file(self, request: Request) -> Response:
        name = request.path_params["name"]
        if (content := self._web.get(name)) is None or name == "index.html":
            return _error(404, "There is no such file.")
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

    # What is seen.

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
                    document = await self._in_thread(partial(self._view.document, after_line=line))
                    line = document["log"][-1]["number"] if document["log"] else line
                    yield _event("lab", {"version": self.version, **document})
                for part in await self._in_thread(self._view.signals, seen):
                    yield _event("signals", part)
                await asyncio.sleep(STREAM_SECONDS)
        finally:
            self.streams -= 1

    # Campaign files.

    async def _campaign_files(self, _asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(self._files.listed)

    async def _campaign_file(self, asked: Asked) -> Mapping[str, Any]:
        kind, name = asked.named("kind"), asked.named("name")
        if kind not in ("shipped", "file") or not re.fullmatch(CAMPAIGN_NAME, name):
            raise RefusedError(404, f"There is no campaign {name!r} on this page.")
        return {"document": await self._in_thread(self._files.document, kind, name)}

    async def _schema(self, _asked: Asked) -> Mapping[str, Any]:
        return Campaign.model_json_schema()

    async def _template(self, asked: Asked) -> Mapping[str, Any]:
        rig = await self._in_thread(self._lab.describe, asked.named("rig"))
        return {"document": await self._in_thread(self._files.template, rig)}

    async def _checked_campaign(self, asked: Asked) -> tuple[Campaign, str, Rig | None]:
        document = asked.values.document
        name = document.get("rig")
        there = isinstance(name, str) and name in self._lab.rig_names()
        rig = await self._in_thread(self._lab.describe, name) if there else None
        plan, text = await self._in_thread(self._files.checked, document, rig)
        return plan, text, rig

    async def _check_campaign(self, asked: Asked) -> Mapping[str, Any]:
        plan, text, rig = await self._checked_campaign(asked)
        if asked.values.save:
            await self._in_thread(partial(self._files.save, plan, text, replace=asked.values.replace))
            self._view.say(f"The campaign file {plan.name} is saved.", who=asked.who)
        return {"text": text, "remarks": plan.remarks, "rig_is_here": rig is not None}

    async def _preview(self, asked: Asked) -> Mapping[str, Any]:
        plan, text, rig = await self._checked_campaign(asked)
        if rig is None:
            raise RefusedError(400, f"There is no rig {plan.rig!r} in this lab, so that its channels are not known.")
        return await self._in_child("target", text, self._files.folder, rig)

    async def _upload(self, asked: Asked) -> Mapping[str, Any]:
        kept = await self._files.upload(asked.named("name"), asked.request.stream())
        path = self._files.folder / kept
        try:
            found = await self._in_child("read", path)
        except LabError:
            path.unlink(missing_ok=True)
            raise
        self._view.say(f"The file {kept} was put on this page.", who=asked.who)
        return {"file": kept, **found}

    async def _in_child(self, job: str, *values: Any) -> dict[str, Any]:
        return await asyncio.get_running_loop().run_in_executor(self._children, partial(work, job, *values))

    # Recordings.

    async def _recordings(self, asked: Asked) -> Mapping[str, Any]:
        given = {name: asked.request.query_params.get(name, "") for name in ("rig", "target", "result")}
        catalogue = self._lab.catalogue
        found = await self._in_thread(
            lambda: catalogue.search(rig=given["rig"], target=given["target"], result=given["result"] or None)
        )
        newest = list(reversed(found))[:MOST_RECORDINGS]
        return {
            "recordings": [recording_document(each) for each in newest],
            "found": len(found),
            "results": list(Result),
        }

    async def _verify(self, asked: Asked) -> Mapping[str, Any]:
        return {"findings": await self._in_thread(self._lab.catalogue.verify, asked.named("id"))}

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
        """Fetch recordings, have something made of them, and send it; nothing of it stays here."""
        passing = await self._in_thread(
            partial(tempfile.TemporaryDirectory, prefix="duralab-page-", ignore_cleanup_errors=True)
        )
        try:
            folder = Path(passing.name)
            fetched = [
                await self._in_thread(self._lab.catalogue.fetch, id, folder / str(number))
                for number, id in enumerate(ids)
            ]
            await self._in_child(job, fetched if job == "compare" else fetched[0], *values, folder / name)
            content = await self._in_thread((folder / name).read_bytes)
        finally:
            await self._in_thread(passing.cleanup)
        if name.endswith(".html"):
            # It runs scripts of its own, apart from this page: it can neither read nor send anything.
            return Response(content, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})
        disposition = f'attachment; filename="{ids[0]}.{name}"'
        return Response(content, media_type="application/octet-stream", headers={"content-disposition": disposition})

    # What is seen of a rig and a campaign.

    async def _describe(self, asked: Asked) -> Mapping[str, Any]:
        return rig_document(await self._in_thread(self._lab.describe, asked.named("rig")))

    async def _target(self, asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(lambda: target_document(self._lab.catalogue.target(asked.named("id"))))

    async def _proposal(self, asked: Asked) -> Mapping[str, Any]:
        found = await self._in_thread(self._lab.proposal, asked.named("id"))
        if found is None:
            return {"proposal": None}
        drive = None if found.drive is None else await self._in_thread(signals_document, found.drive)
        return {"proposal": proposal_document(found), "drive": drive}

    # What is done.

    async def _arm(self, asked: Asked) -> Mapping[str, Any]:
        if asked.session is None:
            raise RefusedError(401, "You are not signed in.")
        return {"word": self._arming.arm(asked.session.token, asked.values.action, asked.values.values)}

    async def _stop_all(self, asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(self._commands.stop_all, asked.who, asked.values.reason)

    async def _stop(self, asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(self._commands.stop, asked.named("rig"), asked.who, asked.values.reason)

    async def _stop_campaign(self, asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(self._commands.stop_campaign, asked.named("id"), asked.who, asked.values.reason)

    async def _take(self, asked: Asked) -> Mapping[str, Any]:
        return self._commands.take(asked.named("rig"), asked.who)

    async def _release(self, asked: Asked) -> Mapping[str, Any]:
        return self._commands.release(asked.named("rig"), asked.who)

    async def _reset(self, asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(self._commands.reset, asked.named("rig"), asked.who, asked.values.reason)

    async def _pre_test(self, asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(self._commands.pre_test, asked.named("rig"), asked.who)

    async def _begin(self, asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(self._commands.begin, asked.values, asked.who)

    async def _decide(self, asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(self._commands.decide, asked.named("id"), asked.values, asked.who)

    async def _resume(self, asked: Asked) -> Mapping[str, Any]:
        return await self._in_thread(self._commands.resume, asked.named("id"), asked.values, asked.who)


class _Shell:
    """Around everything: the name the page is reached by, and headers that browsers keep to."""

    def __init__(self, app: ASGIApp, is_own_name: Callable[[str], bool], config: PageConfig) -> None:
        self._app, self._is_own_name = app, is_own_name
        viewer = "{0.scheme}://{0.netloc}".format(urlsplit(config.viewer)) if config.viewer else "'none'"
        policy = {"content-security-policy": POLICY.format(viewer=viewer)}
        secure = {"strict-transport-security": "max-age=31536000"} if config.tls is not None else {}
        self._headers = HEADERS | policy | secure

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers.setdefault(name, value)
            await send(message)

        host = dict(scope["headers"]).get(b"host", b"").decode("latin-1")
        app = self._app if self._is_own_name(host) else _error(421, "The page is not reached by this name.")
        await app(scope, receive, send_with_headers)


def _files(folder: str) -> list[Any]:
    return [entry for entry in (files("operator_page") / folder).iterdir() if entry.is_file()]


def _event(kind: str, document: Mapping[str, Any]) -> bytes:
    return f"event: {kind}\ndata: {json.dumps(document, allow_nan=False)}\n\n".encode()


def _error(status: int, sentence: str, *, field: str = "") -> JSONResponse:
    return JSONResponse({"error": sentence, "field": field}, status_code=status)


async def _body(request: Request) -> dict[str, Any]:
    """Return the JSON object of a request, which is not large."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise RefusedError(415, "The request is no JSON document.")
    content = b""
    async for piece in request.stream():
        content += piece
        if len(content) > LARGEST_BODY:
            raise RefusedError(413, f"The request is larger than {LARGEST_BODY // 1024} KiB.")
    try:
        found = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise RefusedError(400, "The request is no JSON document.") from error
    if not isinstance(found, dict):
        raise RefusedError(400, "The request is not a JSON object.")
    return found
