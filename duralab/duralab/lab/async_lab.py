"""The lab for `async` code: what `Lab` does, in threads of its own; cancelling a task stops what it asked for."""

from __future__ import annotations

import asyncio
import contextvars
import threading
from collections.abc import AsyncIterator, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, asynccontextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self, TypeVar

import numpy as np

from duralab.campaign import Campaign
from duralab.data import Model, Played, Rig, Rigs, RigState, Signals
from duralab.errors import LabError
from duralab.lab.campaigns import CampaignResult
from duralab.lab.catalogue import Catalogue
from duralab.lab.identifier import Identifier
from duralab.lab.lab import Lab
from duralab.lab.opening import DEFAULT_RIGS, FIND_SECONDS, FREE_ENDPOINT, connect, start
from duralab.lab.progress import OnProgress, RunProgress
from duralab.lab.watching import LabEvent, Watch, Watched
from duralab_bus import BusError
from duralab_proto.keys import ANY
from duralab_settings import EstimatorSettings, ExcitationSettings

if TYPE_CHECKING:
    import xarray

T = TypeVar("T")

_MOST_AT_ONCE: Final = 64
"""Calls that wait for the lab at the same time; more wait for one of them."""


class AsyncLab:
    """A lab on the bus for `async` code; made by `async_start` and `async_connect`.

    Every method is that of `Lab`, awaited. Cancelling the task that awaits a playback, an identification or a campaign
    stops it: the rig ramps down and is latched, and only then the cancellation goes on. `on_progress` is called in the
    event loop.

    Parameters
    ----------
    lab : Lab
        The lab.
    threads : ThreadPoolExecutor
        Where its methods run.
    """

    def __init__(self, lab: Lab, threads: ThreadPoolExecutor) -> None:
        self.lab = lab
        """The same lab for code that is not `async`, e.g. in a thread."""
        self._threads = threads

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Where others may connect to this lab."""
        return self.lab.endpoints

    @property
    def catalogue(self) -> Catalogue:
        """`Lab.catalogue`; its calls are not `async`."""
        return self.lab.catalogue

    @property
    def identifier(self) -> Identifier:
        """`Lab.identifier`; its calls are not `async`, but `identify` here is."""
        return self.lab.identifier

    async def rigs(self) -> Rigs:
        """Return all rigs that are there; see `Lab.rigs`."""
        return await self._call(self.lab.rigs)

    async def describe(self, rig: str) -> Rig:
        """Return what a rig is; see `Lab.describe`."""
        return await self._call(lambda: self.lab.describe(rig))

    async def state(self, rig: str) -> RigState:
        """Return what a rig does now; see `Lab.state`."""
        return await self._call(lambda: self.lab.state(rig))

    async def reset(self, rig: str) -> RigState:
        """Clear the latch of a rig; see `Lab.reset`."""
        return await self._call(lambda: self.lab.reset(rig))

    async def stop_rig(self, rig: str, *, reason: str = "") -> RigState:
        """Ramp a rig down and latch it; see `Lab.stop_rig`."""
        return await self._call(lambda: self.lab.stop_rig(rig, reason=reason))

    async def play(
        self,
        rig: str,
        drive: np.ndarray | xarray.DataArray | xarray.Dataset | Signals,
        *,
        run: str | None = None,
        seed: int = 0,
        real_time: bool = False,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
    ) -> Played:
        """Play a drive of shape (drives, samples) and wait for the response; see `Lab.play`."""
        tell = _in_loop(on_progress)
        return await self._stoppable(
            lambda cancel: self.lab.play(
                rig,
                drive,
                run=run,
                seed=seed,
                real_time=real_time,
                on_progress=tell,
                timeout_seconds=timeout_seconds,
                cancel=cancel,
            )
        )

    async def identify(
        self,
        rig: str,
        excitation: ExcitationSettings,
        estimator: EstimatorSettings,
        *,
        seed: int = 0,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
    ) -> Model:
        """Run an experiment on a rig and return the model; see `Lab.identify`."""
        tell = _in_loop(on_progress)
        return await self._stoppable(
            lambda cancel: self.lab.identify(
                rig,
                excitation,
                estimator,
                seed=seed,
                on_progress=tell,
                timeout_seconds=timeout_seconds,
                cancel=cancel,
            )
        )

    async def run(
        self,
        campaign: Campaign | str | Path,
        *,
        out: str | Path | None = None,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
    ) -> CampaignResult:
        """Run a campaign to its end; see `Lab.run`."""
        tell = _in_loop(on_progress)
        return await self._stoppable(
            lambda cancel: self.lab.run(
                campaign, out=out, on_progress=tell, timeout_seconds=timeout_seconds, cancel=cancel
            )
        )

    async def resume(
        self,
        id: str | Path,
        *,
        settings: Campaign | str | Path | None = None,
        from_iteration: int = 0,
        out: str | Path | None = None,
        replace: bool = True,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
    ) -> CampaignResult:
        """Go on with a campaign; see `Lab.resume`."""
        tell = _in_loop(on_progress)
        return await self._stoppable(
            lambda cancel: self.lab.resume(
                id,
                settings=settings,
                from_iteration=from_iteration,
                out=out,
                replace=replace,
                on_progress=tell,
                timeout_seconds=timeout_seconds,
                cancel=cancel,
            )
        )

    async def stop(self, id: str, *, reason: str = "") -> RunProgress:
        """Stop a campaign; see `Lab.stop`."""
        return await self._call(lambda: self.lab.stop(id, reason=reason))

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

        return AsyncWatch(await self._call(begin), self._threads)

    async def _call(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)

    async def _stoppable(self, work: Callable[[threading.Event], T]) -> T:
        cancel, context = threading.Event(), contextvars.copy_context()
        done = asyncio.get_running_loop().run_in_executor(self._threads, lambda: context.run(work, cancel))
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


class AsyncWatch(AsyncIterator[LabEvent]):
    """Live events of a lab; made by `AsyncLab.watch`, see `Watch`. A task that is cancelled closes it."""

    def __init__(self, watch: Watch, threads: ThreadPoolExecutor) -> None:
        self._watch = watch
        self._threads = threads

    @property
    def dropped(self) -> int:
        """Events that gave way to newer ones because nobody took them."""
        return self._watch.dropped

    async def __anext__(self) -> LabEvent:
        """Wait for the next event."""
        try:
            event = await asyncio.get_running_loop().run_in_executor(self._threads, lambda: next(self._watch, None))
        except asyncio.CancelledError:
            # The thread that waits is let go of; closing takes a moment, which is not the event loop's.
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

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Listen no more."""
        await self.close()


@asynccontextmanager
async def async_start(
    out: str | Path | None = None,
    *,
    listen: str = FREE_ENDPOINT,
    recordings: str | Path | None = None,
    rigs: Sequence[str] = DEFAULT_RIGS,
    viewer: str | None = None,
    real_time: bool = False,
) -> AsyncIterator[AsyncLab]:
    """Start a private lab on this machine, `async with async_start() as lab`; see `start`.

    Parameters
    ----------
    out, listen, recordings, rigs, viewer, real_time
        As in `start`.

    Yields
    ------
    AsyncLab
        Open until the `async with` statement ends.

    Raises
    ------
    InputError, LabError
        As in `start`.
    """
    opening = start(out, listen=listen, recordings=recordings, rigs=rigs, viewer=viewer, real_time=real_time)
    async with _opened(opening) as opened:
        yield opened


@asynccontextmanager
async def async_connect(
    endpoint: str | None = None,
    *,
    out: str | Path | None = None,
    timeout_seconds: float = FIND_SECONDS,
    identity: str | Path | None = None,
) -> AsyncIterator[AsyncLab]:
    """Join a lab that runs already, `async with async_connect() as lab`; see `connect`.

    Parameters
    ----------
    endpoint, out, timeout_seconds, identity
        As in `connect`.

    Yields
    ------
    AsyncLab
        Open until the `async with` statement ends.

    Raises
    ------
    InputError, UnavailableError
        As in `connect`.
    """
    async with _opened(connect(endpoint, out=out, timeout_seconds=timeout_seconds, identity=identity)) as opened:
        yield opened


@asynccontextmanager
async def _opened(lab: AbstractContextManager[Lab]) -> AsyncIterator[AsyncLab]:
    loop = asyncio.get_running_loop()
    with ThreadPoolExecutor(_MOST_AT_ONCE, thread_name_prefix="duralab") as threads:
        entering = loop.run_in_executor(threads, lab.__enter__)
        try:
            opened = await asyncio.shield(entering)
        except asyncio.CancelledError:
            # It is half open: what was started must not outlive the task.
            with suppress(LabError):
                await asyncio.shield(entering)
                await loop.run_in_executor(threads, lab.__exit__, None, None, None)
            raise
        try:
            yield AsyncLab(opened, threads)
        finally:
            await loop.run_in_executor(threads, lab.__exit__, None, None, None)


def _in_loop(on_progress: OnProgress | None) -> OnProgress | None:
    """Return a callback for another thread that calls this one in the running loop."""
    if on_progress is None:
        return None
    loop, told = asyncio.get_running_loop(), on_progress
    return lambda progress: loop.call_soon_threadsafe(told, progress) and None
