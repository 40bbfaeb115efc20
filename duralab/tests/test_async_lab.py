"""A lab for `async` code is opened with all that one for other code is opened with."""

import asyncio
import inspect
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

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
