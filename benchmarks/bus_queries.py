"""Times of queries over the bus, and of the detection of a dead or frozen service."""

import signal
import threading
import time
from collections.abc import Callable

import numpy as np
from bus_peers import peers

import duralab_bus
from duralab_proto.v1 import rig_pb2

QUERIES, BULK_QUERIES, REPETITIONS = 500, 30, 3


def measure_queries(hub: duralab_bus.Bus) -> dict[str, float]:
    """Return the time from query to answer in s, for a small answer and for one of 2 MB."""
    with peers() as start:
        start("serve", endpoint=hub.listening[0]).read()
        hub.wait_for_live({("rig_sim", "bench")}, 60.0)
        keys = hub.keys
        small = [
            _timed(lambda: hub.query(keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState))
            for _ in range(QUERIES)
        ]
        bulk = [
            _timed(
                lambda: hub.query(keys.rig_description("bench"), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
            )
            for _ in range(BULK_QUERIES)
        ]
    return {
        "round_trip_p50": float(np.median(small)),
        "round_trip_p99": float(np.quantile(small, 0.99)),
        "reply_of_2_MB_p50": float(np.median(bulk)),
    }


def measure_notice(hub: duralab_bus.Bus) -> dict[str, float]:
    """Return the longest of a few times until a query to a dead or frozen service ends."""
    figures: dict[str, float] = {}
    for name, number in (("dead", signal.SIGKILL), ("frozen", signal.SIGSTOP)):
        figures[name] = max(_noticed_once(hub, number) for _ in range(REPETITIONS))
    return figures


def _noticed_once(hub: duralab_bus.Bus, number: signal.Signals) -> float:
    with peers() as start:
        peer = start("serve", endpoint=hub.listening[0])
        peer.read()
        hub.wait_for_live({("rig_sim", "bench")}, 60.0)
        ended: list[float] = []

        def ask() -> None:
            try:
                hub.query(hub.keys.rig_frf("bench"), rig_pb2.RigFrfRequest(), rig_pb2.RigFrf)
            except duralab_bus.FaultError:
                ended.append(time.monotonic())

        asking = threading.Thread(target=ask)
        asking.start()
        time.sleep(1.0)
        struck = time.monotonic()
        peer.process.send_signal(number)
        asking.join()
        peer.end()
        while hub.live("rig_sim"):
            time.sleep(0.05)
    return ended[0] - struck


def _timed(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
