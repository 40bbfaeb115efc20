"""A lab that works for a long time: campaigns one after the other, questions beside them, flat memory."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from duralab_bus import FaultError
from duralab_proto.v1 import recorder_pb2, rig_pb2

from .disturbed_campaign import Operator, Round
from .lab_under_fault import RIG, SERVICES, LabUnderFault
from .reference import Reference

GROWTH_MEBIBYTES = 48.0
GROWTH_SHARE = 0.1
_SAMPLE_SECONDS = 2.0
_SHORTEST_MINUTES = 8.0
"""Spools of runs that are over are kept for a minute, and allocators take a while: nothing shorter judges memory."""


@dataclass
class Soak:
    """What a long run showed."""

    minutes: float
    campaigns: int = 0
    queries: int = 0
    early: dict[str, float] = field(default_factory=dict)
    """Median of the resident memory in the second quarter of the time, in MiB, by service."""
    late: dict[str, float] = field(default_factory=dict)
    """The same in the last quarter."""
    findings: list[str] = field(default_factory=list)


def soak(reference: Reference, folder: Path, *, minutes: float) -> Soak:
    """Run campaigns and queries for so long, prove every recording, and look whether any service grows."""
    result = Soak(minutes)
    over, deleting = threading.Event(), threading.Lock()
    memory: list[dict[str, float]] = []
    with LabUnderFault(folder) as lab:
        threads = [
            threading.Thread(target=_ask, args=(lab, result, deleting, over)),
            threading.Thread(target=_watch, args=(lab, memory, over)),
        ]
        for thread in threads:
            thread.start()
        try:
            _campaigns(lab, reference, result, deleting=deleting, until=time.monotonic() + 60.0 * minutes)
        finally:
            over.set()
            for thread in threads:
                thread.join()
        result.findings += lab.defects()
    quarter = len(memory) // 4
    for name in SERVICES:
        early, late = ([each[name] for each in part] for part in (memory[quarter : 2 * quarter], memory[3 * quarter :]))
        result.early[name], result.late[name] = float(np.median(early)), float(np.median(late))
        growth = result.late[name] - result.early[name]
        if minutes >= _SHORTEST_MINUTES and growth > max(GROWTH_MEBIBYTES, GROWTH_SHARE * result.early[name]):
            result.findings.append(f"soak: {name} grew by {growth:.0f} MiB in half of {minutes:g} minutes")
    return result


def _campaigns(
    lab: LabUnderFault, reference: Reference, result: Soak, *, deleting: threading.Lock, until: float
) -> None:
    while time.monotonic() < until and not lab.dead():
        result.campaigns += 1
        outcome = Round("soak", result.campaigns)
        Operator(lab, reference, outcome).perform(lambda _stack: "", moment=0.0)
        result.findings += outcome.findings
        # A lab keeps everything until somebody deletes it: here, so that a long run fits on a disk.
        with deleting:
            for path in lab.recordings.glob(f"soak-{result.campaigns:02d}*"):
                path.unlink()
    result.findings += [f"soak: {name} ended by itself" for name in lab.dead()]


def _ask(lab: LabUnderFault, result: Soak, deleting: threading.Lock, over: threading.Event) -> None:
    bus, keys = lab.bus, lab.bus.keys
    questions = (
        (keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription),
        (keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState),
        (keys.recordings(), recorder_pb2.ListRecordingsRequest(), recorder_pb2.RecordingList),
    )
    while not over.wait(0.02):
        key, request, kind = questions[result.queries % len(questions)]
        try:
            with deleting:
                bus.query(key, request, kind)
        except FaultError as fault:
            result.findings.append(f"soak: {key}: {fault.message}")
            return
        result.queries += 1


def _watch(lab: LabUnderFault, memory: list[dict[str, float]], over: threading.Event) -> None:
    memory.append(lab.resident_mebibytes())
    while not over.wait(_SAMPLE_SECONDS):
        if lab.dead():
            return
        memory.append(lab.resident_mebibytes())
