"""The workers of one key: a bounded number waits, and nobody waits for room for ever."""

import threading

import pytest

from duralab_bus.queries.server import MOST_WAITING, WorkerPool

WAIT = 20.0


class Held:
    """A job that runs until it is let go."""

    def __init__(self):
        self.began, self.go = threading.Event(), threading.Event()

    def run(self):
        self.began.set()
        assert self.go.wait(WAIT)


@pytest.fixture
def full():
    pool, first = WorkerPool(1, name="test", patience_seconds=60.0), Held()
    pool.submit(first)
    assert first.began.wait(WAIT)
    for _ in range(MOST_WAITING):
        done = Held()
        done.go.set()
        pool.submit(done)
    yield pool, first
    first.go.set()
    pool.close()


def waits_for_room(pool):
    there = threading.Event()
    thread = threading.Thread(target=lambda: (pool.wait_for_room(), there.set()), daemon=True)
    thread.start()
    return there


def test_room_is_waited_for_until_a_worker_has_taken_a_job(full):
    pool, first = full
    there = waits_for_room(pool)
    assert not there.wait(0.1)
    first.go.set()
    assert there.wait(WAIT)


def test_a_pool_that_closes_keeps_nobody_waiting(full):
    pool, _ = full
    there = waits_for_room(pool)
    assert len(pool.close()) == MOST_WAITING
    assert there.wait(WAIT)
    assert not pool.submit(Held())


def test_room_is_there_when_those_that_waited_too_long_are_taken_away():
    pool, first = WorkerPool(1, name="test", patience_seconds=0.0), Held()
    pool.submit(first)
    assert first.began.wait(WAIT)
    for _ in range(MOST_WAITING):
        pool.submit(Held())
    there = waits_for_room(pool)
    assert len(pool.take_overdue()) == MOST_WAITING
    assert there.wait(WAIT)
    first.go.set()
