"""HTTP endpoints, their callers, and the threads and processes that answer."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeVar

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from operator_page.accounts import PageRole
from operator_page.child import work
from operator_page.requests import Values
from operator_page.sessions import Session

LARGEST_BODY: Final = 256 * 1024

ResultT = TypeVar("ResultT")


class RefusedError(Exception):
    """Refusal of a request, with its reason in one sentence."""

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
        """Name of the person who sends the request."""
        return self.session.name if self.session is not None else ""

    def named(self, name: str) -> str:
        """Return a name in the path."""
        return str(self.request.path_params[name])


@dataclass(frozen=True)
class Endpoint:
    """An endpoint: its role, its values, and whether it needs a second act.

    `role`: The lowest allowed one; None for every client of the page. `values`: None for a read-only request. `raw`:
    Whether its body is a file.
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
        """HTTP method: GET to read, POST to act."""
        return "GET" if self.values is None else "POST"


class Workers:
    """Threads and processes that answer requests, so that the web server's thread never waits."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(32, thread_name_prefix="page")
        self._children = ThreadPoolExecutor(2, thread_name_prefix="page-child")

    async def in_thread(self, job: Callable[..., ResultT], *values: Any) -> ResultT:
        """Run a function on a thread."""
        return await asyncio.get_running_loop().run_in_executor(self._threads, job, *values)

    async def in_child(self, job: str, *values: Any) -> dict[str, Any]:
        """Run a job of `operator_page.child` in a separate process."""
        return await asyncio.get_running_loop().run_in_executor(self._children, partial(work, job, *values))


def error_answer(status: int, sentence: str, *, field: str = "") -> JSONResponse:
    """Return the answer to a refused request."""
    return JSONResponse({"error": sentence, "field": field}, status_code=status)


async def json_body(request: Request) -> dict[str, Any]:
    """Return the JSON object of a request of limited size."""
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
