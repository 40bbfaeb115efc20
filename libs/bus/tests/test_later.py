"""Jobs that are done later, on one thread."""

from __future__ import annotations

import threading

from duralab_bus.streams.replay import DelayedExecutor


def test_jobs_are_done_in_the_order_of_their_times_on_one_thread():
    later, done, over = DelayedExecutor("test"), [], threading.Event()

    def job(name):
        def do():
            done.append((name, threading.get_ident()))
            if len(done) == 3:
                over.set()

        return do

    later.put(0.2, job("last"))
    later.put(0.0, job("first"))
    later.put(0.1, job("second"))
    assert over.wait(30.0)
    assert [name for name, _ in done] == ["first", "second", "last"]
    assert len({thread for _, thread in done}) == 1
    later.close()


def test_nothing_is_done_after_the_end_and_its_thread_ends():
    later, done = DelayedExecutor("test of the end"), []
    later.put(3600.0, lambda: done.append(1))
    later.close()
    later.put(0.0, lambda: done.append(2))
    own = [thread for thread in threading.enumerate() if thread.name == "test of the end"]
    for thread in own:
        thread.join(30.0)
    assert done == []
    assert not any(thread.is_alive() for thread in own)
