"""Losses of a specimen: its state between runs, and the rig's inputs in that state.

Within a run nothing changes: damage is counted from the loads of the whole run, including its ramps, and acts from
the next run on. So a run has one state, which depends only on the earlier runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel

from rig_sim.model import RigModel, WearingPart
from rig_sim.parameters import STRICT, NotNegative
from rig_sim.specimen import GainDrift, Share, SpecimenError


class WearState(BaseModel):
    """State of wear of a specimen.

    Parameters
    ----------
    runs : int
        Number of runs that moved it, regardless of their end.
    hours : float
        Played time in h, including ramps.
    damage : dict of str to float
        Miner sum of each part that wears.
    """

    model_config = STRICT

    runs: int = 0
    hours: NotNegative = 0.0
    damage: dict[str, NotNegative] = {}


class Lost(BaseModel):
    """Shares that a part has lost.

    Parameters
    ----------
    stiffness, damping : float
        Lost shares, 0 to 0.95; a strut loses damping only.
    """

    model_config = STRICT

    stiffness: Share = 0.0
    damping: Share = 0.0


@dataclass(frozen=True)
class Condition:
    """A specimen in one state, ready to play.

    Parameters
    ----------
    lost : ndarray, shape (inputs,)
        Lost shares of parts, in the order of the model's inputs after the drives.
    gains : ndarray, shape (responses, 1)
        Gains of the sensors; 1 is as calibrated.
    rest : ndarray, shape (states,)
        State of the rig at rest in this condition.
    """

    lost: np.ndarray
    gains: np.ndarray
    rest: np.ndarray


def lost_by(parts: Iterable[WearingPart], state: WearState) -> dict[str, Lost]:
    """Return the loss of each part in a state."""
    lost = {}
    for part in parts:
        grown = part.wear.grown(state.damage.get(part.name, 0.0))
        lost[part.name] = Lost(stiffness=grown * part.wear.stiffness_lost, damping=grown * part.wear.damping_lost)
    return lost


def gain_changes(model: RigModel, state: WearState) -> dict[str, float]:
    """Return the change of the gain of each drifting response in a state, as a share."""
    changes: dict[str, float] = {}
    for wear in model.assembly.specimen.wear:
        if isinstance(wear, GainDrift):
            amount = (wear.per_run or 0.0) * state.runs
            amount += (wear.per_hour or 0.0) * max(state.hours - wear.from_hours, 0.0)
            changes[wear.channel] = changes.get(wear.channel, 0.0) + amount
    return changes


def lost_inputs(model: RigModel, lost: Mapping[str, Lost]) -> np.ndarray:
    """Return the model's inputs after the drives; raises `SpecimenError` if a part has no wear of this kind."""
    parts = {part.name: part for part in model.assembly.wearing}
    for name, shares in lost.items():
        if name not in parts:
            raise SpecimenError(f"{name!r} is no part that wears; there are {', '.join(parts) or 'none'}.")
        if shares.stiffness > 0.0 and len(parts[name].inputs) == 1:
            raise SpecimenError(f"{name!r} is a strut, which loses damping only; leave out its stiffness.")
    values: list[float] = []
    for name, part in parts.items():
        shares = lost.get(name, Lost())
        values += (shares.stiffness, shares.damping)[-len(part.inputs) :]
    return np.array(values)


def gain_column(model: RigModel, changes: Mapping[str, float]) -> np.ndarray:
    """Return the gains of the responses (responses, 1); raises `SpecimenError` if a channel does not exist."""
    gains = np.ones((len(model.response_names), 1))
    for channel, change in changes.items():
        if channel not in model.response_names:
            raise SpecimenError(f"{channel!r} is no response; there are {', '.join(model.response_names)}.")
        gains[model.response_names.index(channel)] += change
    return gains


def damage_of(part: WearingPart, load: np.ndarray) -> float:
    """Return the Miner sum of a load (samples,) in N or m."""
    # Only a rig that wears counts cycles; the others need not import it.
    from duralab_loads import count_load_cycles, pseudo_damage

    wear = part.wear
    return pseudo_damage(count_load_cycles(load / wear.reference_range), wear.exponent) / wear.reference_cycles
