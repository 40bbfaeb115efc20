"""How much of its actuators, and of the oil behind them, a playback used."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from duralab_gateway.motion import Use
from rig_sim.hydraulics import HydraulicActuator

#: From this share of the largest load pressure on, an actuator counts as saturated: little flow is left to move it.
FULL_LOAD_PRESSURE = 0.95


class UseMeter:
    """Counts through a playback, block by block."""

    def __init__(
        self, actuators: Sequence[HydraulicActuator], *, drives: Sequence[str], outputs: Sequence[str]
    ) -> None:
        self._drives = tuple(drives)
        # Rows of the player's inputs and outputs, one for each actuator: all of them are looked at together.
        self._driven = [drives.index(actuator.name) for actuator in actuators]
        self._achieved = [outputs.index(actuator.achieved) for actuator in actuators]
        self._valve = [outputs.index(f"{actuator.name}.valve_command") for actuator in actuators]
        self._load_pressure = [outputs.index(f"{actuator.name}.load_pressure") for actuator in actuators]
        self._supply_pressure = [outputs.index(f"{actuator.supply}.pressure") for actuator in actuators]
        self._largest_opening = np.array([[actuator.valve.largest_opening] for actuator in actuators])
        self._saturated = np.zeros(len(drives))
        self._following = np.zeros(len(drives))
        self._load = np.zeros(len(drives))
        self._supply = np.full(len(drives), np.inf)

    def following_error(self, commands: np.ndarray, outputs: np.ndarray) -> np.ndarray:
        """Return command less achieved value."""
        error = np.zeros(commands.shape)
        if self._driven:
            error[self._driven] = commands[self._driven] - outputs[self._achieved]
        return error

    def count(self, following_error: np.ndarray, outputs: np.ndarray) -> None:
        """Take a block of the drive into account."""
        driven = self._driven
        if not driven:
            return
        valve, load = np.abs(outputs[self._valve]), np.abs(outputs[self._load_pressure])
        at_its_end = (valve >= self._largest_opening) | (load >= FULL_LOAD_PRESSURE)
        self._saturated[driven] += np.count_nonzero(at_its_end, axis=1)
        largest_error = np.abs(following_error[driven]).max(axis=1)
        self._following[driven] = np.maximum(self._following[driven], largest_error)
        self._load[driven] = np.maximum(self._load[driven], load.max(axis=1))
        lowest = outputs[self._supply_pressure].min(axis=1)
        self._supply[driven] = np.minimum(self._supply[driven], lowest)

    def uses(self, peak_ratios: Sequence[float], *, samples: int) -> list[Use]:
        """Return how every drive channel was used."""
        return [
            Use(
                drive=drive,
                peak_command_ratio=float(peak_ratios[index]),
                saturated_share=float(self._saturated[index] / max(samples, 1)),
                largest_following_error=float(self._following[index]),
                largest_load_pressure_share=float(self._load[index]),
                lowest_supply_pressure=float(self._supply[index]) if np.isfinite(self._supply[index]) else 0.0,
            )
            for index, drive in enumerate(self._drives)
        ]
