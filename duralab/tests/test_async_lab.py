"""A lab for `async` code is opened with all that one for other code is opened with."""

import asyncio
import inspect
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
