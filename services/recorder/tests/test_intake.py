"""What is not yet on the disk has a bound; who delivers more waits and loses nothing."""

from __future__ import annotations

import threading

from duralab_bus import StreamItem
from duralab_proto.v1 import rig_pb2
from recorder.log import Intake

ITEMS = [StreamItem("k", 1, seq, rig_pb2.SignalBlock(), b"x" * 9000) for seq in range(8)]


def test_a_deliverer_waits_until_what_it_delivered_is_safe():
    intake = Intake(most_bytes=25_000)
    delivered, through = [], threading.Semaphore(0)

    def deliver():
        for item in ITEMS:
            intake.admit(item)
            delivered.append(item)
            through.release()

    threading.Thread(target=deliver, daemon=True).start()
    # Three pass the bound together; each that is safe lets one more through, in order.
    for passed in range(3, len(ITEMS) + 1):
        for _ in range(3 if passed == 3 else 1):
            assert through.acquire(timeout=10.0)
        assert not through.acquire(timeout=0.05)
        assert delivered == ITEMS[:passed]
        intake.settle([delivered[passed - 3]])


def test_nobody_is_held_up_at_the_end():
    intake = Intake(most_bytes=1)
    through = threading.Event()

    def deliver():
        for item in ITEMS:
            intake.admit(item)
        through.set()

    threading.Thread(target=deliver, daemon=True).start()
    intake.close()
    assert through.wait(10.0)


def test_poses_are_settled_without_having_been_admitted_and_free_no_room():
    intake = Intake(most_bytes=25_000)
    intake.settle(ITEMS)
    assert intake.bytes == 0
    assert intake.lag_seconds == 0.0
    for item in ITEMS[:2]:
        intake.admit(item)
    assert intake.bytes == 2 * (9000 + 1024)
    assert intake.lag_seconds > 0.0
    intake.settle(ITEMS)
    assert (intake.bytes, intake.lag_seconds) == (0, 0.0)
