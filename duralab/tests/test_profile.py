"""The shares of a profile, against events whose answer is plain, and against the sum that they must have."""

import json

import numpy as np
import pytest

from duralab.profile import Profile, profiled
from duralab_bus import SpanKind, span

PLAYBACK, MATHEMATICS, WAITING = SpanKind.PLAYBACK, SpanKind.MATHEMATICS, SpanKind.WAITING


def event(kind, began, ended, *, pid=1, tid=1):
    return {"ph": "X", "name": "a", "cat": kind.value, "ts": began * 1e6, "dur": (ended - began) * 1e6} | {
        "pid": pid,
        "tid": tid,
    }


def told(events, began=0.0, ended=10.0):
    return {kind: seconds for kind, seconds in Profile(events).shares(began, ended).items() if seconds > 1e-9}


def test_a_span_inside_another_of_its_thread_takes_its_time():
    outer, inner = event(MATHEMATICS, 1.0, 9.0), event(WAITING, 3.0, 5.0)
    assert told([outer, inner], 1.0, 9.0) == pytest.approx({MATHEMATICS: 6.0, WAITING: 2.0})
    assert told([inner, outer], 1.0, 9.0) == pytest.approx({MATHEMATICS: 6.0, WAITING: 2.0})


def test_where_two_processes_work_the_playback_counts_and_where_none_does_it_is_waiting():
    events = [event(MATHEMATICS, 1.0, 5.0), event(PLAYBACK, 4.0, 7.0, pid=2), event(WAITING, 5.0, 7.0)]
    assert told(events) == pytest.approx({MATHEMATICS: 3.0, PLAYBACK: 3.0, WAITING: 4.0})


def test_spans_that_begin_together_and_those_that_reach_beyond_their_outer_one():
    assert told([event(PLAYBACK, 1.0, 2.0), event(MATHEMATICS, 1.0, 4.0)], 1.0, 4.0) == pytest.approx(
        {PLAYBACK: 1.0, MATHEMATICS: 2.0}
    )
    assert told([event(MATHEMATICS, 1.0, 4.0), event(PLAYBACK, 3.0, 6.0)], 1.0, 6.0) == pytest.approx(
        {PLAYBACK: 1.0, MATHEMATICS: 2.0, WAITING: 2.0}
    )


def test_shares_of_any_spans_add_up_to_the_time_between_the_moments():
    random = np.random.default_rng(5)
    for _ in range(50):
        begins, lengths = random.uniform(0.0, 10.0, 40), random.exponential(1.0, 40)
        kinds, threads = random.choice(list(SpanKind), 40), random.integers(1, 5, 40)
        events = [
            event(SpanKind(kind), began, began + length, tid=int(thread))
            for kind, began, length, thread in zip(kinds, begins, lengths, threads, strict=True)
        ]
        shares = Profile(events).shares(2.0, 9.0)
        assert sum(shares.values()) == pytest.approx(7.0)
        assert min(shares.values()) >= 0.0


def test_a_profile_is_written_also_where_what_it_is_of_fails_and_leaves_nothing_else(tmp_path):
    path, found = tmp_path / "out" / "profile.json", []
    with pytest.raises(ZeroDivisionError), profiled(path, show=found.append), span("divide", MATHEMATICS):
        raise ZeroDivisionError
    events = json.loads(path.read_text())["traceEvents"]
    assert [one["name"] for one in events] == ["process_name", "start duralab", "divide", "end of the command"]
    assert min(one["ts"] for one in events if one["ph"] == "X") == 0.0
    assert "mathematics" in str(found[0])
    assert list(path.parent.iterdir()) == [path]
    with span("after", MATHEMATICS):
        pass
    assert len(json.loads(path.read_text())["traceEvents"]) == 4


def test_a_line_that_a_killed_process_left_unfinished_is_passed_over(tmp_path):
    line = json.dumps(event(PLAYBACK, 1.0, 2.0))
    (tmp_path / "rig_sim.jsonl").write_text(f"{line}\n{line[:20]}")
    assert Profile.read(tmp_path).period == (1.0, 2.0)
