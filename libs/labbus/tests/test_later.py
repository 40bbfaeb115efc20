"""Jobs that are done later, on one thread."""

from __future__ import annotations

import threading

from labbus._later import Later


def test_jobs_are_done_in_the_order_of_their_times_on_one_thread():
    later, done, over = Later("test"), [], threading.Event()

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
    before = threading.active_count()
    later, done = Later("test"), []
    later.put(3600.0, lambda: done.append(1))
    later.close()
    later.put(0.0, lambda: done.append(2))
    for thread in threading.enumerate():
        if thread.name == "test" and thread is not threading.current_thread():
            thread.join(30.0)
    assert done == []
    assert threading.active_count() == before
