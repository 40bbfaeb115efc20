"""Cables between hosts: they delay, lose, hold back and are cut as they are told."""

from __future__ import annotations

import os
import subprocess

import pytest

from .host_network import HOSTS, HostNetwork, why_not
from .wire_process import Wire


def out(wire: Wire, now: float) -> list[bytes]:
    return [frame for _, frame in wire.due(now)]


def test_delayed_frames_come_in_order_and_not_before() -> None:
    wire = Wire(1)
    wire.delay = 0.5
    for number in range(3):
        wire.take(bytes([number]), 1, 10.0)
    assert out(wire, 10.49) == []
    assert out(wire, 10.5) == [b"\0", b"\1", b"\2"]


def test_rate_spaces_frames_and_a_full_queue_drops() -> None:
    wire = Wire(1)
    wire.rate = 1000.0
    for _ in range(20):
        wire.take(bytes(100), 0, 5.0)
    # A tenth of a second each; none that would wait for longer than a quarter.
    assert len(out(wire, 5.1001)) == 1
    assert len(out(wire, 60.0)) == 2
    wire.take(bytes(100), 1, 5.0)
    assert len(out(wire, 5.1001)) == 1


def test_lost_frames_are_the_same_for_a_seed_and_as_many_as_said() -> None:
    def lost(seed: int) -> list[bool]:
        wire = Wire(seed)
        wire.loss = 0.2
        kept = []
        for number in range(2000):
            wire.take(b"x", 1, float(number))
            kept.append(bool(out(wire, float(number))))
        return kept

    assert lost(3) == lost(3) != lost(4)
    assert 0.15 < 1.0 - sum(lost(3)) / 2000 < 0.25


def test_cut_cable_passes_nothing_not_even_what_is_under_way() -> None:
    wire = Wire(1)
    wire.delay = 1.0
    wire.take(b"before", 1, 0.0)
    wire.cut = True
    wire.take(b"during", 1, 0.5)
    assert out(wire, 2.0) == []
    wire.cut = False
    wire.take(b"after", 1, 2.0)
    assert out(wire, 3.0) == [b"after"]


@pytest.mark.skipif(bool(why_not()), reason=why_not() or "possible")
def test_hosts_reach_each_other_until_a_cable_is_cut() -> None:
    def reaches(network: HostNetwork, one: str, other: str) -> bool:
        probe = (
            "import socket, sys; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.settimeout(1.0);"
            "s.connect((sys.argv[1], 9)); s.send(b'?')\ntry:\n    s.recv(1)\nexcept ConnectionRefusedError:\n"
            "    sys.exit(0)\nexcept OSError:\n    sys.exit(1)"
        )
        command = network.on(one, ["python3", "-c", probe, network.address(other)])
        return subprocess.run(command, capture_output=True, check=False).returncode == 0

    with HostNetwork(f"duralabtest{os.getpid()}") as network:
        assert all(reaches(network, "control", host) for host in HOSTS)
        network.change("rig", cut=True)
        assert not reaches(network, "control", "rig")
        assert reaches(network, "control", "router")
        network.change("rig", cut=False)
        assert reaches(network, "control", "rig")
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert f"duralabtest{os.getpid()}" not in left
