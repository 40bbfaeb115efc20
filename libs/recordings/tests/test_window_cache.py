import tracemalloc

import numpy as np

from duralab_recordings import Window, WindowCache, windows

RUN = "demo.i01"


def fill(cache, numbers, *, samples=1):
    for number in numbers:
        if cache.find((RUN, number, number + samples)) is None:
            cache.keep((RUN, number, number + samples), Window(np.ones((2, samples)), np.ones((3, samples))))


def kept(cache, numbers, *, samples=1):
    return [number for number in numbers if cache.find((RUN, number, number + samples)) is not None]


def test_so_many_windows_are_kept_as_fit_and_those_that_were_used_last(monkeypatch):
    monkeypatch.setattr(windows, "CACHE_BYTES", 10 * (5 * 8 * 1000 + windows.WINDOW_BYTES))
    cache = WindowCache()
    fill(cache, range(10), samples=1000)
    assert kept(cache, [0], samples=1000) == [0]
    fill(cache, range(10, 13), samples=1000)
    assert kept(cache, range(13), samples=1000) == [0, 4, 5, 6, 7, 8, 9, 10, 11, 12]
    fill(cache, [0], samples=100_000)
    assert kept(cache, [0], samples=100_000) == [0], "the newest, however large"
    assert kept(cache, range(13), samples=1000) == []


def test_windows_of_single_samples_take_no_more_memory_than_is_counted(monkeypatch):
    monkeypatch.setattr(windows, "CACHE_BYTES", 2**20)
    cache = WindowCache()
    tracemalloc.start()
    try:
        fill(cache, range(1000, 5000))
        taken, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(kept(cache, range(1000, 5000))) > 500
    assert taken < 2**20


def test_a_window_that_two_threads_read_is_counted_once(monkeypatch):
    monkeypatch.setattr(windows, "CACHE_BYTES", 10 * (5 * 8 + windows.WINDOW_BYTES))
    cache = WindowCache()
    for _ in range(20):
        cache.keep((RUN, 0, 1), Window(np.ones((2, 1)), np.ones((3, 1))))
    fill(cache, range(1, 10))
    assert kept(cache, range(10)) == list(range(10))
