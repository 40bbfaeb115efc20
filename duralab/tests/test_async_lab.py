"""A lab for `async` code is opened with all that one for other code is opened with."""

import asyncio
import inspect
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

import duralab
from duralab.lab import async_lab


@pytest.mark.parametrize(
    ("other", "own"), [(duralab.connect, duralab.async_connect), (duralab.start, duralab.async_start)]
)
def test_the_same_can_be_given(other, own):
    assert inspect.signature(own).parameters == inspect.signature(other).parameters


def test_what_is_given_to_join_a_lab_arrives():
    given = {}

    @contextmanager
    def connect(endpoint, **options):
        given.update(options, endpoint=endpoint)
        yield None

    async def script(options):
        async with async_lab.asynchronous(connect)("tls/lab:7447", **options):
            pass

    options = {"out": "mine", "timeout_seconds": 2.0, "identity": "certificates/operator.anna"}
    asyncio.run(script(options))
    assert given == {"endpoint": "tls/lab:7447", **options}


def run_in_a_lab(method, **given):
    """Await a method of a lab as `AsyncLab` does; return the result and the thread of the event loop."""

    async def script():
        with ThreadPoolExecutor(1) as threads:
            lab = async_lab.AsyncLab(None, threads)
            return await async_lab._stoppable(method)(lab, **given), threading.get_ident()

    return asyncio.run(script())


def test_every_event_of_a_project_is_announced_in_the_event_loop():
    called = []

    def run_project(lab, project, *, on_progress, on_event, cancel):
        on_progress("half")
        on_event(project)
        return threading.get_ident()

    worker, loop = run_in_a_lab(
        run_project,
        project="tracks",
        on_progress=lambda what: called.append((what, threading.get_ident())),
        on_event=lambda what: called.append((what, threading.get_ident())),
    )
    assert worker != loop
    assert called == [("half", loop), ("tracks", loop)]


def test_what_moves_a_rig_in_a_lab_is_in_the_lab_for_async_code():
    moving = {
        name
        for name, method in inspect.getmembers(duralab.Lab, inspect.isfunction)
        if "cancel" in inspect.signature(method).parameters and not name.startswith("_")
    }
    assert "run_project" in moving
    assert not moving - set(dir(async_lab.AsyncLab))


def public_methods(of):
    return {name for name, _ in inspect.getmembers(of, inspect.isfunction) if not name.startswith("_")}


def test_an_endurance_test_for_async_code_has_every_method_of_one():
    assert {"endure", "endurance"} <= public_methods(async_lab.AsyncLab)
    assert public_methods(duralab.AsyncEnduranceTest) == public_methods(duralab.EnduranceTest)
    blocking, own = (inspect.signature(of.endure).parameters for of in (duralab.Lab, duralab.AsyncLab))
    assert [(name, each.default) for name, each in own.items()] == [
        (name, each.default) for name, each in blocking.items()
    ]


class EndlessTest(duralab.EnduranceTest):
    """Plays for ever; what it is asked comes from the thread of `asked`."""

    def __init__(self):
        super().__init__(None, "weeks", "axle")
        self.asked = []

    def progress(self):
        self.asked.append(threading.get_ident())
        return SimpleNamespace(phase=duralab.EndurancePhase.PLAYING)


def test_an_endurance_test_is_started_in_a_thread_and_continues_where_its_wait_is_cancelled():
    test, given = EndlessTest(), {}

    def endure(schedule, **options):
        given.update(options, schedule=schedule)
        return test

    async def script():
        with ThreadPoolExecutor(2) as threads:
            lab = async_lab.AsyncLab(SimpleNamespace(endure=endure, endurance=lambda id: test), threads)
            started = await lab.endure("weeks.yaml", id="weeks", seed=3)
            assert isinstance(started, duralab.AsyncEnduranceTest)
            assert (started.id, lab.endurance("weeks").test) == ("weeks", test)
            told = asyncio.Queue()
            waiting = asyncio.create_task(started.wait(on_progress=told.put_nowait))
            await told.get()
            waiting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await waiting
            return threading.get_ident()

    loop = asyncio.run(script())
    assert given == {"schedule": "weeks.yaml", "id": "weeks", "seed": 3, "real_time": False}
    assert test.asked
    assert loop not in test.asked
