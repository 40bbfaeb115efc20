"""Opening the bus: what cannot work is said in one sentence, soon."""

import socket
import time

import pytest
from pydantic import ValidationError

import duralab_bus
from duralab_proto.v1 import rig_pb2


@pytest.fixture
def taken_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        yield taken.getsockname()[1]


@pytest.fixture
def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def refusal(**config):
    with pytest.raises(duralab_bus.BusError) as caught:
        duralab_bus.open_bus(duralab_bus.BusConfig(**config), service="test")
    message = str(caught.value)
    assert message.endswith((".", "?"))
    assert "\n" not in message
    assert ".rs:" not in message
    return message


def test_port_in_use_is_named(taken_port):
    endpoint = f"tcp/127.0.0.1:{taken_port}"
    assert f"{endpoint} is in use" in refusal(listen=(endpoint,))


def test_address_of_another_machine_cannot_be_listened_at():
    # 192.0.2.0/24 is for documentation: no machine has it.
    for port in (0, 7474):
        assert "Cannot listen at tcp/192.0.2.1" in refusal(listen=(f"tcp/192.0.2.1:{port}",))


@pytest.mark.parametrize("mode", list(duralab_bus.BusMode))
def test_nothing_listening_is_said_after_the_time_allowed(free_port, mode):
    began = time.monotonic()
    message = refusal(mode=mode, connect=(f"tcp/127.0.0.1:{free_port}",), connect_timeout_seconds=0.3)
    assert f"Nothing listens at tcp/127.0.0.1:{free_port} (tried for 0.3 s)" in message
    # Not the 5 s of a configuration that says nothing.
    assert time.monotonic() - began < 4.5


def test_stranger_that_listens_is_told_from_nothing(taken_port):
    message = refusal(connect=(f"tcp/127.0.0.1:{taken_port}",), connect_timeout_seconds=0.3)
    assert "answers but" in message


@pytest.mark.parametrize(
    "config",
    [
        {"listen": ("127.0.0.1:7474",)},
        {"listen": ("tcp/127.0.0.1",)},
        {"listen": ("tcp/127.0.0.1:99999",)},
        {"listen": ("udp/127.0.0.1:7474",)},
        {"connect": ("tcp/127.0.0.1:0",)},
        {"connect": ("tcp/a b:1",)},
        {"listen": ()},
        {"mode": "client"},
        {"mode": "broker"},
        {"lab": "My Lab"},
        {"colour": "red"},
        {"connect_timeout_seconds": 0},
    ],
)
def test_malformed_configuration_is_refused(config):
    with pytest.raises(ValidationError):
        duralab_bus.BusConfig.model_validate(config)


def test_listening_endpoint_has_its_actual_port(hub):
    (endpoint,) = hub.listening
    assert endpoint.startswith("tcp/127.0.0.1:")
    assert not endpoint.endswith(":0")


@pytest.mark.parametrize("mode", [duralab_bus.BusMode.PEER, duralab_bus.BusMode.CLIENT])
def test_sessions_behind_a_router_ask_each_other(mode):
    with duralab_bus.open_bus(duralab_bus.BusConfig(mode=duralab_bus.BusMode.ROUTER), service="router") as router:
        config = duralab_bus.BusConfig(mode=mode, connect=router.listening)
        with duralab_bus.open_bus(config, service="rig_sim") as rig, duralab_bus.open_bus(config, service="sdk") as sdk:
            rig.serve(rig.keys.rig_state("r"), rig_pb2.StateRequest, lambda *_: rig_pb2.RigState(rig="r"))
            rig.declare_live("rig_sim", "r")
            assert sdk.query(sdk.keys.rig_state("r"), rig_pb2.StateRequest(), rig_pb2.RigState).rig == "r"


def test_peers_go_on_after_the_hub_has_gone():
    hub = duralab_bus.open_bus(service="hub")
    config = duralab_bus.BusConfig(connect=hub.listening)
    with duralab_bus.open_bus(config, service="rig_sim") as rig, duralab_bus.open_bus(config, service="sdk") as sdk:
        rig.serve(rig.keys.rig_state("r"), rig_pb2.StateRequest, lambda *_: rig_pb2.RigState(rig="r"))
        rig.declare_live("rig_sim", "r")
        sdk.wait_for_live({("rig_sim", "r")}, 120.0)
        hub.close()
        assert sdk.query(sdk.keys.rig_state("r"), rig_pb2.StateRequest(), rig_pb2.RigState).rig == "r"


def test_closing_twice_is_harmless_and_nothing_goes_after_it(hub):
    hub.declare_live("rig_sim", "r")
    hub.wait_for_live({("rig_sim", "r")}, 120.0)
    publisher = hub.publisher(hub.keys.rig_state("r"))
    hub.close()
    hub.close()
    with pytest.raises(duralab_bus.BusError, match="closed"):
        publisher.put(rig_pb2.RigState())
    with pytest.raises(duralab_bus.BusError, match="closed"):
        hub.query(hub.keys.rig_state("r"), rig_pb2.StateRequest(), rig_pb2.RigState)
