"""Streams of which the recorder can read no message: their publishers do not wait for it."""

from __future__ import annotations

import time

from duralab_bus import BusConfig, open_bus
from duralab_proto.v1 import rig_pb2
from recorder.config import RecorderConfig
from recorder.service import build

LONGEST_SECONDS = 60.0


def test_stream_that_cannot_be_read_is_let_go_although_nothing_was_ever_stored(tmp_path):
    config = RecorderConfig(bus=BusConfig(lab="test"), folder=tmp_path)
    with open_bus(config.bus, service="recorder") as bus, build(config)(bus):
        publisher = bus.publisher(bus.keys.rig_state("r"))
        for _ in range(20):
            publisher.put(rig_pb2.StopRequest(reason="of another type"))
        until = time.monotonic() + LONGEST_SECONDS
        while publisher.unmarked and time.monotonic() < until:
            time.sleep(0.02)
        assert publisher.unmarked == 0
        publisher.close()
