"""The faults: what is done to the lab, for how long, and how it is lifted."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .cuttable_link import Cut
from .lab_under_fault import HUB, SERVICES, LabUnderFault, Topology, end_script, start_script
from .malformed_streams import publish_malformed
from .reference import Reference
from .shifted_clock import ShiftedClock, compiler_found

DISK_BYTES = 2**30
"""The recorder stops at 256 MiB that it keeps free: room for the rounds before, and their proofs."""
_LEFT_BYTES = 300_000
_DAY_SECONDS = 86_400.0


@dataclass(frozen=True)
class Scale:
    """How long faults last, in seconds, and how many malformed messages are sent to each stream."""

    shortest: float
    longest: float
    messages: int

    def duration(self, random: np.random.Generator) -> float:
        """Draw a time: short ones as often as long ones, on a logarithmic scale."""
        return float(np.exp(random.uniform(np.log(self.shortest), np.log(self.longest))))


FULL = Scale(shortest=0.5, longest=60.0, messages=1000)
SHORT = Scale(shortest=0.3, longest=3.0, messages=40)


@dataclass(frozen=True)
class Place:
    """The lab that is disturbed, and what belongs to it."""

    lab: LabUnderFault
    reference: Reference
    clock: ShiftedClock | None = None


Bring = Callable[[Place, np.random.Generator, Scale, ExitStack], str]


@dataclass(frozen=True)
class FaultKind:
    """A fault and the lab it needs.

    Parameters
    ----------
    name : str
        As in the table and in the names of the campaigns.
    bring : callable
        Brings it, holds it and lifts it; returns it in words.
    topology : Topology
        Of the lab.
    small_disk, shifted_clock : bool
        What the lab is set up with.
    """

    name: str
    bring: Bring
    topology: Topology = Topology.EMBEDDED
    small_disk: bool = False
    shifted_clock: bool = False


def _kill(victim: str) -> Bring:
    def bring(place: Place, random: np.random.Generator, scale: Scale, _stack: ExitStack) -> str:
        place.lab.kill(victim)
        absent = min(scale.duration(random), 10.0)
        time.sleep(absent)
        place.lab.start(victim)
        return f"gone for {absent:.1f} s"

    return bring


def _restart(victim: str) -> Bring:
    def bring(place: Place, _random: np.random.Generator, _scale: Scale, _stack: ExitStack) -> str:
        code = place.lab.end(victim)
        place.lab.start(victim)
        return f"told to end, exit code {code}, and started again at once"

    return bring


def _freeze(victim: str) -> Bring:
    def bring(place: Place, random: np.random.Generator, scale: Scale, _stack: ExitStack) -> str:
        duration = scale.duration(random)
        with place.lab.frozen(victim):
            time.sleep(duration)
        return f"{duration:.1f} s"

    return bring


def _cut(victim: str) -> Bring:
    def bring(place: Place, random: np.random.Generator, scale: Scale, _stack: ExitStack) -> str:
        how = Cut(random.choice([cut.value for cut in Cut]))
        duration = scale.duration(random)
        link = place.lab.links[victim]
        link.cut(how)
        time.sleep(duration)
        link.heal()
        return f"{how.value}, {duration:.1f} s"

    return bring


def _fill_disk(place: Place, random: np.random.Generator, scale: Scale, _stack: ExitStack) -> str:
    ballast = place.lab.recordings / ".ballast"
    duration = min(scale.duration(random), 20.0)
    left = int(random.integers(_LEFT_BYTES))
    free = shutil.disk_usage(place.lab.recordings).free
    try:
        # Whatever the recorder writes at the same time, the disk is full afterwards.
        with suppress(OSError), ballast.open("wb") as stream:
            for size in (max(0, free - left), left):
                _write(stream.fileno(), size)
        time.sleep(duration)
    finally:
        ballast.unlink()
    return f"full for {duration:.1f} s"


def _write(descriptor: int, size: int) -> None:
    block = bytes(2**20)
    while size > 0:
        size -= os.write(descriptor, block[: min(size, len(block))])


def _jump_clock(place: Place, random: np.random.Generator, scale: Scale, _stack: ExitStack) -> str:
    assert place.clock is not None
    offsets = []
    for _ in range(3):
        offset = float(random.choice([-1.0, 1.0]) * np.exp(random.uniform(0.0, np.log(_DAY_SECONDS))))
        place.clock.set_offset(offset)
        offsets.append(offset)
        time.sleep(random.uniform(0.0, 0.3))
    words = "by " + ", ".join(f"{offset:.0f}" for offset in offsets) + " s"
    if random.random() < 0.5:
        # New streams after the clock went back: their epochs must still be new.
        place.clock.set_offset(-_DAY_SECONDS)
        place.lab.kill("rig_sim")
        place.lab.start("rig_sim")
        words += ", then a day back and a new rig"
    return words


def _deafen(place: Place, random: np.random.Generator, _scale: Scale, stack: ExitStack) -> str:
    subscriber = start_script(Path(__file__).with_name("deaf_process.py"), place.lab.endpoint)
    stack.callback(end_script, subscriber)
    if random.random() < 0.5:
        subscriber.send_signal(signal.SIGSTOP)
        return "a frozen process"
    return "a reader that never reads"


def _malform(place: Place, random: np.random.Generator, scale: Scale, _stack: ExitStack) -> str:
    sent = publish_malformed(place.lab.bus, place.reference, place.lab.endpoint, random=random, each=scale.messages)
    return f"{sent} messages"


FAULTS = (
    *(FaultKind(f"kill {name}", _kill(name)) for name in (*SERVICES, HUB)),
    FaultKind("kill router", _kill(HUB), Topology.ROUTED),
    *(FaultKind(f"restart {name}", _restart(name)) for name in SERVICES),
    *(FaultKind(f"freeze {name}", _freeze(name)) for name in (*SERVICES, HUB)),
    FaultKind("freeze router", _freeze(HUB), Topology.ROUTED),
    *(FaultKind(f"cut {name}", _cut(name), Topology.ROUTED) for name in SERVICES),
    FaultKind("disk full", _fill_disk, small_disk=True),
    FaultKind("clock jumps", _jump_clock, shifted_clock=True),
    FaultKind("deaf subscriber", _deafen),
    FaultKind("malformed streams", _malform),
)


def why_not(kind: FaultKind) -> str:
    """Return why a fault cannot be made on this machine; empty where it can."""
    if kind.shifted_clock and compiler_found() is None:
        return "there is no C compiler (cc) for the clock's shim"
    if kind.small_disk and os.geteuid() != 0:
        return "only root may mount a small file system"
    return ""


@contextmanager
def place_for(kinds: Sequence[FaultKind], reference: Reference, folder: Path) -> Iterator[Place]:
    """Set up the lab that some faults need, all of one topology.

    Raises
    ------
    NotPossibleError
        This machine does not let it.
    """
    with ExitStack() as stack:
        recordings, clock = folder / "recordings", None
        recordings.mkdir(parents=True)
        if any(kind.small_disk for kind in kinds):
            stack.enter_context(_small_disk(recordings))
        if any(kind.shifted_clock for kind in kinds):
            clock = ShiftedClock(folder)
        (topology,) = {kind.topology for kind in kinds}
        lab = LabUnderFault(
            folder,
            topology=topology,
            recordings=recordings,
            environment=clock.environment if clock is not None else None,
        )
        yield Place(stack.enter_context(lab), reference, clock)


class NotPossibleError(Exception):
    """A fault cannot be made on this machine; says why."""


@contextmanager
def _small_disk(folder: Path) -> Iterator[None]:
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", folder],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode != 0:
        raise NotPossibleError(f"a small file system cannot be mounted: {mounted.stderr.strip()}")
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)
