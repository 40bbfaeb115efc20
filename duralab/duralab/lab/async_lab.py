"""Lab for `async` code: runs the calls of `Lab` in threads; cancelling a task stops the run that it started."""

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
"""Maximum number of simultaneous calls; further calls wait for a free thread."""


class _Threaded(Generic[B]):
    """Object with blocking calls, and the threads that run them."""

    def __init__(self, blocking: B, threads: ThreadPoolExecutor) -> None:
        self._blocking = blocking
        self._threads = threads

    async def _in_thread(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)


def _awaited(
    method: Callable[Concatenate[B, P], T],
) -> Callable[Concatenate[_Threaded[B], P], Coroutine[Any, Any, T]]:
    """Return a blocking method as an `async` method that runs in a thread."""

    @wraps(method)
    async def call(self: _Threaded[B], *args: P.args, **kwargs: P.kwargs) -> T:
        return await self._in_thread(lambda: method(self._blocking, *args, **kwargs))

    return call


def _stoppable(
    method: Callable[Concatenate[B, P], T],
) -> Callable[Concatenate[_Threaded[B], P], Coroutine[Any, Any, T]]:
    """Return a blocking method with `cancel` as an `async` method that stops when its task is cancelled."""

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
            # Wait for the stop, so that nothing moves after the cancelled call has returned.
            try:
                await asyncio.shield(done)
            except (LabError, BusError) as error:
                cancelled.add_note(str(error))
            raise

    return call


class AsyncLab(_Threaded[Lab]):
    """Lab on the bus for `async` code; made by `async_start` and `async_connect`.

    The methods are those of `Lab`, as `async` methods without `cancel`. Cancelling the task that awaits a playback, an
    identification, a campaign or a project stops it. The rig ramps down and is latched before the cancellation
    continues.
    `on_progress` and `on_event` are called in the event loop.
    """

    def __init__(self, lab: Lab, threads: ThreadPoolExecutor) -> None:
        super().__init__(lab, threads)
        self.lab = lab
        """The same lab for code that is not `async`, e.g. in a thread."""

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Endpoints at which other processes can connect to this lab."""
        return self.lab.endpoints

    @property
    def catalogue(self) -> Catalogue:
        """`Lab.catalogue`; its calls are not `async`."""
        return self.lab.catalogue

    @property
    def identifier(self) -> Identifier:
        """`Lab.identifier`; its calls are not `async`, but `AsyncLab.identify` is."""
        return self.lab.identifier

    rigs = _awaited(Lab.rigs)
    """Return all rigs present; see `Lab.rigs`."""
    describe = _awaited(Lab.describe)
    """Return the description of a rig; see `Lab.describe`."""
    state = _awaited(Lab.state)
    """Return the present state of a rig; see `Lab.state`."""
    reset = _awaited(Lab.reset)
    """Clear the latch of a rig; see `Lab.reset`."""
    stop_rig = _awaited(Lab.stop_rig)
    """Ramp a rig down and latch it; see `Lab.stop_rig`."""
    play = _stoppable(Lab.play)
    """Play a drive of shape (drives, samples) and wait for the response; see `Lab.play`."""
    identify = _stoppable(Lab.identify)
    """Run an experiment on a rig and return the model; see `Lab.identify`."""
    pre_test = _stoppable(Lab.pre_test)
    """Check a rig before a campaign; see `Lab.pre_test`."""
    run = _stoppable(Lab.run)
    """Run a campaign to its end; see `Lab.run`."""
    begin = _stoppable(Lab.begin)
    """Begin a campaign and return; see `Lab.begin`. If the task is cancelled first, the campaign does not begin."""
    run_project = _stoppable(Lab.run_project)
    """Run the events of a project; see `Lab.run_project`."""
    resume = _stoppable(Lab.resume)
    """Continue a campaign; see `Lab.resume`."""
    proposal = _awaited(Lab.proposal)
    """Return the proposal of a campaign that waits at a hold point; see `Lab.proposal`."""
    decide = _awaited(Lab.decide)
    """Decide on a proposal; see `Lab.decide`."""
    stop = _awaited(Lab.stop)
    """Stop a campaign; see `Lab.stop`."""

    async def endure(
        self, schedule: Schedule | str | Path, *, id: str | None = None, seed: int = 0, real_time: bool = False
    ) -> AsyncEnduranceTest:
        """Start an endurance test and return, see `Lab.endure`; the test continues if the task is cancelled."""
        started = partial(self.lab.endure, schedule, id=id, seed=seed, real_time=real_time)
        return AsyncEnduranceTest(await self._in_thread(started), self._threads)

    def endurance(self, id: str) -> AsyncEnduranceTest:
        """Return an endurance test of this lab, see `Lab.endurance`; not `async`, because it sends no request."""
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
    """Endurance test of a lab for `async` code; made by `AsyncLab.endure` and `AsyncLab.endurance`.

    The methods are those of `EnduranceTest`, as `async` methods. Cancelling the task that awaits `wait` ends the wait;
    the test continues.
    """

    def __init__(self, test: EnduranceTest, threads: ThreadPoolExecutor) -> None:
        super().__init__(test, threads)
        self.test = test
        """The same test for code that is not `async`."""

    @property
    def id(self) -> str:
        """Name of the test."""
        return self.test.id

    def history(self) -> EnduranceHistory:
        """`EnduranceTest.history`; its calls are not `async`."""
        return self.test.history()

    progress = _awaited(EnduranceTest.progress)
    """Return the progress of the test; see `EnduranceTest.progress`."""
    wait = _stoppable(EnduranceTest.wait)
    """Wait for the end of the test; see `EnduranceTest.wait`."""
    hold = _awaited(EnduranceTest.hold)
    """Hold the test after the current repeat; see `EnduranceTest.hold`."""
    resume = _awaited(EnduranceTest.resume)
    """Continue after a hold; see `EnduranceTest.resume`."""
    decide = _awaited(EnduranceTest.decide)
    """Decide on a hold; see `EnduranceTest.decide`."""
    stop = _awaited(EnduranceTest.stop)
    """End the test, and stop and latch its rig; see `EnduranceTest.stop`."""


class AsyncWatch(AsyncIterator[LabEvent]):
    """Live events of a lab; made by `AsyncLab.watch`, see `Watch`. Cancelling the waiting task closes the watch."""

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
            # Closing releases the waiting thread. It takes some time, so it runs in a thread, not in the event loop.
            self._threads.submit(self._watch.close)
            raise
        if event is None:
            raise StopAsyncIteration
        return event

    async def close(self) -> None:
        """Stop listening."""
        await asyncio.get_running_loop().run_in_executor(self._threads, self._watch.close)

    async def __aenter__(self) -> Self:
        """Return the watch, which already listens."""
        return self

    async def __aexit__(self, *_: object) -> None:
        """Stop listening."""
        await self.close()


def asynchronous(
    opening: Callable[P, AbstractContextManager[Lab]],
) -> Callable[P, AbstractAsyncContextManager[AsyncLab]]:
    """Return a function that opens a lab as one for `async with`, with the same arguments."""

    @wraps(opening)
    @asynccontextmanager
    async def opened(*args: P.args, **kwargs: P.kwargs) -> AsyncIterator[AsyncLab]:
        lab, loop = opening(*args, **kwargs), asyncio.get_running_loop()
        with ThreadPoolExecutor(_MOST_AT_ONCE, thread_name_prefix="duralab") as threads:
            entering = loop.run_in_executor(threads, lab.__enter__)
            try:
                entered = await asyncio.shield(entering)
            except asyncio.CancelledError:
                # The lab is being opened: the processes it started must not outlive the task.
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
"""Join a running lab, `async with async_connect() as lab`; see `connect`."""
