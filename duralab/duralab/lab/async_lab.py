"""The lab for `async` code: what `Lab` does, in its own threads; cancelling a task stops what it asked for."""

from __future__ import annotations

import asyncio
import contextvars
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, AbstractContextManager, asynccontextmanager, suppress
from functools import partial, wraps
from pathlib import Path
from typing import Any, Concatenate, Final, Generic, ParamSpec, Self, TypeVar

from duralab.errors import InputError, LabError
from duralab.lab.catalogue import Catalogue
from duralab.lab.endurance import EnduranceHistory, EnduranceTest
from duralab.lab.identifier import Identifier
from duralab.lab.lab import Lab
from duralab.lab.opening import connect, start
from duralab.lab.watching import LabEvent, Watch, Watched
from duralab_bus import BusError
from duralab_proto.keys import ANY
from duralab_schedules import Schedule

P = ParamSpec("P")
T = TypeVar("T")
B = TypeVar("B")

_MOST_AT_ONCE: Final = 64
"""Calls that wait for the lab at the same time; more wait for one of them."""


class _Threaded(Generic[B]):
    """An object with calls that block, and the threads in which they do."""

    def __init__(self, blocking: B, threads: ThreadPoolExecutor) -> None:
        self._blocking = blocking
        self._threads = threads

    async def _in_thread(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)


def _awaited(
    method: Callable[Concatenate[B, P], T],
) -> Callable[Concatenate[_Threaded[B], P], Coroutine[Any, Any, T]]:
    """Return a method that blocks as one that is awaited, in a thread."""

    @wraps(method)
    async def call(self: _Threaded[B], *args: P.args, **kwargs: P.kwargs) -> T:
        return await self._in_thread(lambda: method(self._blocking, *args, **kwargs))

    return call


def _stoppable(
    method: Callable[Concatenate[B, P], T],
) -> Callable[Concatenate[_Threaded[B], P], Coroutine[Any, Any, T]]:
    """Return a method that takes `cancel` as one that is awaited, and stopped where its task is cancelled."""

    @wraps(method)
    async def call(self: _Threaded[B], *args: P.args, **kwargs: P.kwargs) -> T:
        if kwargs.get("cancel") is not None:
            raise InputError("cancel is given; leave it out, and cancel the task that awaits.", field="cancel")
        cancel, context = threading.Event(), contextvars.copy_context()
        given: dict[str, Any] = {**kwargs, "cancel": cancel}
        for name in ("on_progress", "on_event"):
            if (callback := given.get(name)) is not None:
                given[name] = partial(asyncio.get_running_loop().call_soon_threadsafe, callback)
        done = asyncio.get_running_loop().run_in_executor(
            self._threads, lambda: context.run(partial(method, self._blocking, *args, **given))
        )
        try:
            return await asyncio.shield(done)
        except asyncio.CancelledError as cancelled:
            cancel.set()
            # What was asked for is stopped when this returns: nothing moves behind the back of who cancelled it.
            try:
                await asyncio.shield(done)
            except (LabError, BusError) as error:
                cancelled.add_note(str(error))
            raise

    return call


class AsyncLab(_Threaded[Lab]):
    """A lab on the bus for `async` code; made by `async_start` and `async_connect`.

    Every method is that of `Lab`, awaited and without `cancel`: cancelling the task that awaits a playback, an
    identification, a campaign or a project stops it. The rig ramps down and is latched, and only then the cancellation
    continues.
    `on_progress` and `on_event` are called in the event loop.
    """

    def __init__(self, lab: Lab, threads: ThreadPoolExecutor) -> None:
        super().__init__(lab, threads)
        self.lab = lab
        """The same lab for code that is not `async`, e.g. in a thread."""

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Endpoints at which others can connect to this lab."""
        return self.lab.endpoints

    @property
    def catalogue(self) -> Catalogue:
        """`Lab.catalogue`; its calls are not `async`."""
        return self.lab.catalogue

    @property
    def identifier(self) -> Identifier:
        """`Lab.identifier`; its calls are not `async`, but `identify` here is."""
        return self.lab.identifier

    rigs = _awaited(Lab.rigs)
    """Return all rigs present; see `Lab.rigs`."""
    describe = _awaited(Lab.describe)
    """Return what a rig is; see `Lab.describe`."""
    state = _awaited(Lab.state)
    """Return what a rig does now; see `Lab.state`."""
    reset = _awaited(Lab.reset)
    """Clear the latch of a rig; see `Lab.reset`."""
    stop_rig = _awaited(Lab.stop_rig)
    """Ramp a rig down and latch it; see `Lab.stop_rig`."""
    play = _stoppable(Lab.play)
    """Play a drive of shape (drives, samples) and wait for the response; see `Lab.play`."""
    identify = _stoppable(Lab.identify)
    """Run an experiment on a rig and return the model; see `Lab.identify`."""
    pre_test = _stoppable(Lab.pre_test)
    """Look at a rig before a campaign; see `Lab.pre_test`."""
    run = _stoppable(Lab.run)
    """Run a campaign to its end; see `Lab.run`."""
    begin = _stoppable(Lab.begin)
    """Begin a campaign and return; see `Lab.begin`. Cancelled, it ends before the campaign begins."""
    run_project = _stoppable(Lab.run_project)
    """Run the events of a project; see `Lab.run_project`."""
    resume = _stoppable(Lab.resume)
    """Continue a campaign; see `Lab.resume`."""
    proposal = _awaited(Lab.proposal)
    """Return what a campaign waits with at a hold point; see `Lab.proposal`."""
    decide = _awaited(Lab.decide)
    """Decide on it; see `Lab.decide`."""
    stop = _awaited(Lab.stop)
    """Stop a campaign; see `Lab.stop`."""

    async def endure(
        self, schedule: Schedule | str | Path, *, id: str | None = None, seed: int = 0, real_time: bool = False
    ) -> AsyncEnduranceTest:
        """Start an endurance test and return, see `Lab.endure`; it continues where the task is cancelled."""
        started = partial(self.lab.endure, schedule, id=id, seed=seed, real_time=real_time)
        return AsyncEnduranceTest(await self._in_thread(started), self._threads)

    def endurance(self, id: str) -> AsyncEnduranceTest:
        """Return an endurance test of this lab, see `Lab.endurance`; not awaited, because nothing is asked yet."""
        return AsyncEnduranceTest(self.lab.endurance(id), self._threads)

    async def watch(
        self,
        *,
        rig: str = ANY,
        campaign: str = ANY,
        kinds: Sequence[Watched] = tuple(Watched),
        timeout_seconds: float | None = None,
    ) -> AsyncWatch:
        """Watch the lab live, `async for event in await lab.watch()`; see `Lab.watch`."""

        def begin() -> Watch:
            return self.lab.watch(rig=rig, campaign=campaign, kinds=kinds, timeout_seconds=timeout_seconds)

        return AsyncWatch(await self._in_thread(begin), self._threads)


class AsyncEnduranceTest(_Threaded[EnduranceTest]):
    """One endurance test of a lab for `async` code; made by `AsyncLab.endure` and `AsyncLab.endurance`.

    Every method is that of `EnduranceTest`, awaited. Cancelling the task that awaits `wait` ends the wait; the test
    continues.
    """

    def __init__(self, test: EnduranceTest, threads: ThreadPoolExecutor) -> None:
        super().__init__(test, threads)
        self.test = test
        """The same test for code that is not `async`."""

    @property
    def id(self) -> str:
        """Its name."""
        return self.test.id

    def history(self) -> EnduranceHistory:
        """`EnduranceTest.history`; its calls are not `async`."""
        return self.test.history()

    progress = _awaited(EnduranceTest.progress)
    """Return how far it is; see `EnduranceTest.progress`."""
    wait = _stoppable(EnduranceTest.wait)
    """Wait for its end; see `EnduranceTest.wait`."""
    hold = _awaited(EnduranceTest.hold)
    """Hold it after the current repeat; see `EnduranceTest.hold`."""
    resume = _awaited(EnduranceTest.resume)
    """Continue after a hold; see `EnduranceTest.resume`."""
    decide = _awaited(EnduranceTest.decide)
    """Decide on a hold; see `EnduranceTest.decide`."""
    stop = _awaited(EnduranceTest.stop)
    """End it, and stop and latch its rig; see `EnduranceTest.stop`."""


class AsyncWatch(AsyncIterator[LabEvent]):
    """Live events of a lab; made by `AsyncLab.watch`, see `Watch`. A task that is cancelled closes it."""

    def __init__(self, watch: Watch, threads: ThreadPoolExecutor) -> None:
        self._watch = watch
        self._threads = threads

    @property
    def dropped(self) -> int:
        """Number of events dropped because the consumer was too slow."""
        return self._watch.dropped

    async def __anext__(self) -> LabEvent:
        """Wait for the next event."""
        try:
            event = await asyncio.get_running_loop().run_in_executor(self._threads, lambda: next(self._watch, None))
        except asyncio.CancelledError:
            # The thread that waits is released; closing takes a moment, which is not the event loop's.
            self._threads.submit(self._watch.close)
            raise
        if event is None:
            raise StopAsyncIteration
        return event

    async def close(self) -> None:
        """Listen no more."""
        await asyncio.get_running_loop().run_in_executor(self._threads, self._watch.close)

    async def __aenter__(self) -> Self:
        """Listen already."""
        return self

    async def __aexit__(self, *_: object) -> None:
        """Listen no more."""
        await self.close()


def asynchronous(
    opening: Callable[P, AbstractContextManager[Lab]],
) -> Callable[P, AbstractAsyncContextManager[AsyncLab]]:
    """Return what opens a lab as one for `async with`, which takes the same arguments."""

    @wraps(opening)
    @asynccontextmanager
    async def opened(*args: P.args, **kwargs: P.kwargs) -> AsyncIterator[AsyncLab]:
        lab, loop = opening(*args, **kwargs), asyncio.get_running_loop()
        with ThreadPoolExecutor(_MOST_AT_ONCE, thread_name_prefix="duralab") as threads:
            entering = loop.run_in_executor(threads, lab.__enter__)
            try:
                entered = await asyncio.shield(entering)
            except asyncio.CancelledError:
                # It is half open: what was started must not outlive the task.
                with suppress(LabError):
                    await asyncio.shield(entering)
                    await loop.run_in_executor(threads, lab.__exit__, None, None, None)
                raise
            try:
                yield AsyncLab(entered, threads)
            finally:
                await loop.run_in_executor(threads, lab.__exit__, None, None, None)

    return opened


async_start = asynchronous(start)
"""Start a private lab on this machine, `async with async_start() as lab`; see `start`."""

async_connect = asynchronous(connect)
"""Join a lab that runs already, `async with async_connect() as lab`; see `connect`."""
