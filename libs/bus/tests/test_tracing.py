"""Spans of several threads, of an iterator, and of no trace at all."""

import json
import threading
import time

import pytest

from duralab_bus import TRACE_SUFFIX, SpanKind, record_trace, span, spans


def events_of(folder, process="one"):
    lines = (folder / f"{process}{TRACE_SUFFIX}").read_text().splitlines()
    return [json.loads(line) for line in lines if '"X"' in line]


def test_spans_of_many_threads_are_whole_lines_with_their_threads(tmp_path):
    def work():
        for number in range(200):
            with span("step", SpanKind.SERVICE, number=number):
                pass

    with record_trace(tmp_path, "one"):
        threads = [threading.Thread(target=work, name=f"worker-{i}") for i in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    events = events_of(tmp_path)
    assert len(events) == 1600
    assert {event["args"]["thread"] for event in events} == {f"worker-{i}" for i in range(8)}


def wait_in_vain():
    with span("wait", SpanKind.WAITING):
        time.sleep(0.02)
        raise OSError("cold")


def test_a_span_is_as_long_as_what_it_holds_and_is_written_where_that_fails(tmp_path):
    with record_trace(tmp_path, "one"):
        before = time.time()
        with pytest.raises(OSError, match="cold"):
            wait_in_vain()
        after = time.time()
    (event,) = events_of(tmp_path)
    assert 20_000 <= event["dur"] <= (after - before) * 1e6 + 1000
    assert before * 1e6 - 1 <= event["ts"] <= after * 1e6
    assert (event["cat"], event["name"]) == ("waiting", "wait")


def test_of_an_iterator_the_making_of_each_item_counts_and_not_what_is_done_with_it(tmp_path):
    with record_trace(tmp_path, "one"):
        for _ in spans(range(3), "item", SpanKind.PLAYBACK):
            time.sleep(0.05)
    made = sorted(event["dur"] for event in events_of(tmp_path))
    assert len(made) == 4
    # The second shortest: another process may have had the processor in one of them.
    assert made[1] < 50_000


def test_without_a_trace_nothing_is_written(tmp_path):
    with span("nothing", SpanKind.DISK):
        pass
    assert list(spans("ab", "letter", SpanKind.DISK)) == ["a", "b"]
    assert list(tmp_path.iterdir()) == []
