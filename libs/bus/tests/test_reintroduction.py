"""Peers that lost each other are told of each other again."""

import duralab_bus


def others(bus):
    return {str(zid) for zid in bus._session.current.info.peers_zid()}


def test_a_session_joins_for_a_moment_when_a_service_vanishes(hub, processes, until):
    config = {"bus": {"connect": list(hub.listening)}}
    rig = processes.start(config)
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=hub.listening), service="test") as peer:
        peer.wait_for_live({("rig_sim", "bench")}, 60.0)
        until(lambda: len(others(hub)) == 2)
        known = others(hub)
        rig.kill()
        until(lambda: others(hub) - known)
        # It leaves again, and its leaving brings nobody else.
        until(lambda: not others(hub) - known)
        assert others(hub) <= known


def test_who_connects_to_nobody_and_clients_introduce_nobody(hub):
    with duralab_bus.open_bus(duralab_bus.BusConfig(mode="client", connect=hub.listening), service="test") as client:
        assert hub._reintroduction._thread is None
        assert client._reintroduction._thread is None
