"""What happens to the network while a campaign runs, and how it is put right."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from ..faults.lab_under_fault import HUB
from .host_network import HOSTS
from .lab_on_hosts import LabOnHosts

DELAY_SECONDS = 0.010
LOSS = 0.01
RATE = 12.5e6
"""Bytes a second: 100 Mbit/s."""

Bring = Callable[[LabOnHosts, np.random.Generator, ExitStack], str]


@dataclass(frozen=True)
class Disturbance:
    """A disturbance; `before` says whether it is there before the campaign starts, else at a random moment in it."""

    name: str
    bring: Bring
    before: bool = False


def _nothing(_lab: LabOnHosts, _random: np.random.Generator, _stack: ExitStack) -> str:
    return "four hosts, mutual TLS"


def _worsen(**settings: float) -> Bring:
    def bring(lab: LabOnHosts, _random: np.random.Generator, stack: ExitStack) -> str:
        for host in HOSTS:
            lab.network.change(host, **settings)
            stack.callback(lab.network.change, host, **dict.fromkeys(settings, 0.0))
        return ", ".join(f"{name} {value:g}" for name, value in settings.items()) + " on every cable"

    return bring


def _cut(host: str) -> Bring:
    def bring(lab: LabOnHosts, random: np.random.Generator, _stack: ExitStack) -> str:
        seconds = float(random.uniform(0.5, 6.0))
        lab.network.change(host, cut=True)
        time.sleep(seconds)
        lab.network.change(host, cut=False)
        return f"{seconds:.1f} s"

    return bring


def _kill_router(lab: LabOnHosts, random: np.random.Generator, _stack: ExitStack) -> str:
    seconds = float(random.uniform(0.5, 4.0))
    lab.kill(HUB)
    time.sleep(seconds)
    lab.start(HUB)
    return f"gone for {seconds:.1f} s"


DISTURBANCES = (
    Disturbance("nothing", _nothing, before=True),
    Disturbance("delay", _worsen(delay=DELAY_SECONDS), before=True),
    Disturbance("loss", _worsen(loss=LOSS), before=True),
    Disturbance("bandwidth", _worsen(rate=RATE), before=True),
    Disturbance("delay, loss and bandwidth", _worsen(delay=DELAY_SECONDS, loss=LOSS, rate=RATE), before=True),
    *(Disturbance(f"cut {host}", _cut(host)) for host in HOSTS),
    Disturbance("kill router", _kill_router),
)
