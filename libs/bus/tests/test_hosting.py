"""Several services in one process, on one session."""

from __future__ import annotations

from contextlib import contextmanager

import pytest
from pydantic import Field

from duralab_bus import BusConfig, ConfigError, HostedService, ServiceConfig, host_services, open_bus
from duralab_proto.v1 import recorder_pb2


class GreetingConfig(ServiceConfig):
    number: int = Field(default=1, ge=1)


ended = []


def service(name):
    def build(config):
        @contextmanager
        def serve(bus):
            key = f"{bus.keys.recordings()}/{name}"
            bus.serve(
                key,
                recorder_pb2.ListRecordingsRequest,
                lambda request, call: recorder_pb2.RecordingList(
                    recordings=[recorder_pb2.RecordingInfo(recording=name, steps=config.number)]
                ),
            )
            yield
            ended.append(name)

        return serve

    return HostedService(name, GreetingConfig, build)


AMONG = {name: service(name) for name in ("recorder", "iterator")}


@pytest.fixture
def bus():
    with open_bus(BusConfig(), service="cell", workers=4) as opened:
        yield opened


def test_hosted_services_answer_are_live_and_end_in_the_reverse_order(bus):
    ended.clear()
    with host_services(bus, {"recorder": {"number": 7}, "iterator": {}}, among=AMONG):
        bus.wait_for_live({("recorder", "main"), ("iterator", "main")}, 10.0)
        for name, number in (("recorder", 7), ("iterator", 1)):
            answer = bus.query(
                f"{bus.keys.recordings()}/{name}", recorder_pb2.ListRecordingsRequest(), recorder_pb2.RecordingList
            )
            assert [(found.recording, found.steps) for found in answer.recordings] == [(name, number)]
    assert ended == ["iterator", "recorder"]


def test_a_service_that_is_not_installed_is_named(bus):
    with pytest.raises(ConfigError, match="weather is not installed here; installed are recorder, iterator"):
        host_services(bus, {"weather": {}}, among=AMONG).__enter__()


def test_a_wrong_setting_is_named_with_its_service(bus):
    with pytest.raises(ConfigError, match="recorder: number is 0"):
        host_services(bus, {"recorder": {"number": 0}}, among=AMONG).__enter__()
