"""Rounds of faults: a campaign for each, disturbed at a random moment that a seed decides."""

from __future__ import annotations

import shutil
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from duralab_bus import BusError, FaultError

from .disturbed_campaign import Operator, Round
from .fault_kinds import FaultKind, NotPossibleError, Place, Scale, place_for
from .lab_under_fault import SERVICES
from .proof import files_of
from .reference import Reference

_WARM_ROUNDS = 5
GROWTH_MEBIBYTES = 10.0
"""Most that a service may grow a round once it is warm: a leak of what a campaign records (25 MB) is far above."""


@dataclass
class Rounds:
    """All rounds of one fault."""

    fault: str
    rounds: list[Round] = field(default_factory=list)
    skipped: str = ""
    growth: dict[str, float] = field(default_factory=dict)
    """Mebibytes a round by which each service grew that was not started anew, after the first few rounds."""

    @property
    def findings(self) -> list[str]:
        """What is wrong, one sentence each."""
        found = [f"{each.fault} {each.number}: {finding}" for each in self.rounds for finding in each.findings]
        grown = [
            f"{self.fault}: {name} grows by {growth:.1f} MiB a round"
            for name, growth in self.growth.items()
            if growth > GROWTH_MEBIBYTES
        ]
        return found + grown


def perform_rounds(
    kind: FaultKind, place: Place, *, rounds: int, seed: int, scale: Scale, tell: Callable[[Round], None]
) -> Rounds:
    """Disturb so many campaigns in a lab, each at a moment of its own.

    Parameters
    ----------
    kind : FaultKind
        The fault.
    place : Place
        The lab, set up for it.
    rounds, seed : int
        How many, and what decides the moments.
    scale : Scale
        How long faults last.
    tell : callable
        Called with each round when it is over.
    """
    done = Rounds(kind.name)
    memory: list[dict[str, tuple[int, float]]] = []
    for number in range(1, rounds + 1):
        random = np.random.default_rng([seed, zlib.crc32(kind.name.encode()), number])
        outcome = Round(kind.name, number)
        operator = Operator(place.lab, place.reference, outcome)
        moment = float(random.uniform(0.0, place.reference.seconds))
        try:
            operator.perform(lambda stack, random=random: kind.bring(place, random, scale, stack), moment=moment)
            outcome.findings += place.lab.defects()
        except (FaultError, BusError, TimeoutError) as error:
            outcome.findings.append(f"broken off: {error}")
        if place.lab.dead():
            outcome.findings.append(f"ended by itself: {', '.join(place.lab.dead())}")
        done.rounds.append(outcome)
        tell(outcome)
        if place.lab.dead():
            break
        resident = place.lab.resident_mebibytes()
        memory.append({name: (place.lab.process_id(name), resident[name]) for name in SERVICES})
        if not outcome.findings:
            _make_room(place, outcome)
    done.growth = _growth(memory)
    return done


def _make_room(place: Place, outcome: Round) -> None:
    """Delete what was proved, so that a long run fits on a disk; what has a finding stays to be looked at."""
    for name in outcome.recordings:
        kept = place.lab.recordings
        for path in [*files_of(kept, name), *kept.glob(f"{name}*.rrd"), *kept.glob(f"damaged/{name}*")]:
            path.unlink()


def _growth(memory: list[dict[str, tuple[int, float]]]) -> dict[str, float]:
    grown: dict[str, float] = {}
    warm = memory[_WARM_ROUNDS:]
    if len(warm) < _WARM_ROUNDS:
        return grown
    for name in SERVICES:
        first, last = warm[0][name], warm[-1][name]
        if first[0] == last[0]:
            grown[name] = (last[1] - first[1]) / (len(warm) - 1)
    return grown


def perform_all(
    kinds: Sequence[FaultKind],
    reference: Reference,
    folder: Path,
    *,
    rounds: int,
    seed: int,
    scale: Scale,
    tell: Callable[[Round], None],
) -> list[Rounds]:
    """Perform the rounds of several faults, each in a lab of its own, so that none has to do with the one before."""
    results: list[Rounds] = []
    for kind in kinds:
        place_folder = folder / kind.name.replace(" ", "_")
        shutil.rmtree(place_folder, ignore_errors=True)
        try:
            with place_for([kind], reference, place_folder) as place:
                results.append(perform_rounds(kind, place, rounds=rounds, seed=seed, scale=scale, tell=tell))
        except NotPossibleError as reason:
            results.append(Rounds(kind.name, skipped=str(reason)))
        except TimeoutError as error:
            failed = Round(kind.name, 0, findings=[f"the lab did not start: {error}"])
            results.append(Rounds(kind.name, rounds=[failed]))
    return results
