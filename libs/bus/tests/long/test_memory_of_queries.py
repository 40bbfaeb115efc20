"""Memory of a client that asks for weeks: a query leaves nothing once its longest time is over."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux says in /proc how much memory is resident")


def growth(hub, processes, *, longest_seconds):
    """Return by how many bytes a query the memory of a client grows, in a process of its own."""
    process = processes.run(
        "long/memory_process.py", hub.listening[0], str(longest_seconds), stdout=subprocess.PIPE, text=True
    )
    return float(process.communicate(timeout=600.0)[0])


def test_memory_of_a_client_does_not_grow_with_its_queries(hub, processes, bench):
    del bench
    assert growth(hub, processes, longest_seconds=0.5) < 100.0


def test_memory_of_a_query_is_held_until_its_longest_time(hub, processes, bench):
    # Why each query has one: should Zenoh hold nothing of a query that is answered, these times are not needed.
    del bench
    assert growth(hub, processes, longest_seconds=3600.0) > 400.0
