"""Many playbacks together: those of rigs with one structure in the lanes of a vector, all others one by one.

A playback here is the one of :meth:`Rig.playback`, with its blocks, sensors, faults and watchdogs; a batch only
answers its requests to the engine, for several playbacks at once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Final
from weakref import WeakKeyDictionary, WeakSet

from duralab_gateway.motion import Block, DrivePlayback, RigFaultError
from rig_sim.checks import check_lanes
from rig_sim.compile import (
    Fingerprint,
    LaneModel,
    TracedModel,
    fingerprint,
    trace_model,
    unite,
    widest_lanes,
)
from rig_sim.engines import Engine
from rig_sim.model import RigModel
from rig_sim.playing.player import Playback

FEWEST_IN_LANES: Final = 3
"""Smallest number of rigs of one structure in lanes; two are as fast one after the other, with two sides in lanes."""

BLOCKS_AT_ONCE: Final = 64
"""Number of blocks played at once: a batch has no subscriber, no bit depends on it, and each block costs some time."""


def play_batch(playbacks: Sequence[DrivePlayback]) -> list[RigFaultError | None]:
    """Play several playbacks to their ends, those of one structure together.

    Rigs have one structure if their equations differ only in constants, and their steps are equal: other masses,
    stiffnesses, valves or wear. Any other rig is played separately.

    Parameters
    ----------
    playbacks : sequence of DrivePlayback
        Playbacks from `Rig.playback`, not begun; of any rigs, each with its drive, seed and condition.

    Returns
    -------
    list of RigFaultError or None
        Fault that ended each playback early; the others continue. Responses and uses are read from the playbacks.

    Raises
    ------
    ProofError
        The code of the lanes disagrees with that of the single rigs.
    """
    ends: dict[int, RigFaultError | None] = {}
    groups: dict[object, list[int]] = {}
    for place, playback in enumerate(playbacks):
        groups.setdefault(_structure_of(playback) or place, []).append(place)
    for places in groups.values():
        together = [playback for place in places if isinstance(playback := playbacks[place], Playback)]
        if min(len(together), widest_lanes()) < FEWEST_IN_LANES:
            ends |= {place: _play_alone(playbacks[place]) for place in places}
        else:
            ends |= dict(zip(places, _play_in_lanes(together), strict=True))
    return [ends[place] for place in range(len(playbacks))]


@dataclass(frozen=True)
class _Traced:
    """Equations of a rig and their common part with other rigs."""

    model: TracedModel
    fingerprint: Fingerprint


_traced: WeakKeyDictionary[RigModel, _Traced] = WeakKeyDictionary()


def _trace(model: RigModel) -> _Traced:
    found = _traced.get(model)
    if found is None:
        traced = trace_model(model.traced, state_names=model.state_names, input_names=model.input_names)
        found = _traced[model] = _Traced(traced, fingerprint(traced))
    return found


def _structure_of(playback: DrivePlayback) -> object:
    """Return a key that playbacks must share to be played together; None for one that is played alone."""
    if not isinstance(playback, Playback) or playback.rig.engine.engine is not Engine.COMPILED:
        return None
    model, steps = playback.rig.model, playback.rig.steps
    names = model.state_names, model.input_names, model.output_names
    return _trace(model).fingerprint.digest, names, tuple(steps.values())


def _play_alone(playback: DrivePlayback) -> RigFaultError | None:
    try:
        for _ in playback.blocks():
            pass
    except RigFaultError as fault:
        return fault
    return None


@dataclass(frozen=True)
class _Seat:
    """A playback in a lane; `block_samples` is the block length of the playback alone."""

    place: int
    playback: Playback
    variant: int
    blocks: Iterator[Block]
    block_samples: int


def _play_in_lanes(playbacks: Sequence[Playback]) -> list[RigFaultError | None]:
    rigs = {playback.rig.model: playback.rig for playback in playbacks}
    variants = list(rigs)
    lanes = _lane_model(tuple(variants), len(playbacks))
    if lanes not in _proven:
        check_lanes(lanes, [(rig.model, rig.compiled) for rig in rigs.values()])
        _proven.add(lanes)
    ends: list[RigFaultError | None] = [None] * len(playbacks)
    waiting = deque(enumerate(playbacks))
    seats: list[_Seat] = []
    while waiting or seats:
        while waiting and len(seats) < lanes.rigs:
            place, playback = waiting.popleft()
            blocks = chain(playback.approach(), playback.blocks())
            seats.append(_Seat(place, playback, variants.index(playback.rig.model), blocks, playback.block_samples))
            playback.block_samples *= BLOCKS_AT_ONCE
        runs = [seat.playback.next_run() for seat in seats]
        for seat in (seat for seat, run in zip(seats, runs, strict=True) if run is None):
            seat.playback.block_samples = seat.block_samples
        asked = [(seat, run) for seat, run in zip(seats, runs, strict=True) if run is not None]
        seats = [seat for seat, _ in asked]
        if not seats:
            continue
        answers = lanes.play([seat.variant for seat in seats], [run for _, run in asked], **seats[0].playback.rig.steps)
        for seat, played in zip(list(seats), answers, strict=True):
            if played.diverged_at is not None and seat.playback.block_samples > seat.block_samples:
                # With its own block length again, so that it keeps all blocks up to its end, as alone.
                seat.playback.block_samples = seat.block_samples
                continue
            seat.playback.give(played)
            try:
                next(seat.blocks)
            except RigFaultError as fault:
                ends[seat.place] = fault
                seats.remove(seat)
    return ends


_proven: WeakSet[LaneModel] = WeakSet()


@lru_cache(maxsize=4)
def _lane_model(models: tuple[RigModel, ...], runs: int) -> LaneModel:
    traced = [_trace(model) for model in models]
    return LaneModel(
        unite([each.model for each in traced], [each.fingerprint for each in traced]),
        runs=runs,
        state_names=models[0].state_names,
        input_names=models[0].input_names,
        output_names=models[0].output_names,
    )
