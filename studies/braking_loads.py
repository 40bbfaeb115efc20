"""The spindle-coupled rig in braking mode, and loads of a car that brakes: eight drives, eight responses."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from low_level_campaigns import BAND, DISPLACEMENT, IDENTIFIED, SAMPLE_RATE, identify, predecessor_target
from numpy.typing import NDArray
from studied_rigs import AXLE_BLOCK

from duralab_settings import EstimatorKind, EstimatorSettings
from identifier import white
from iterator import RigModel
from rig_sim import PlayableRig, load_any_rig, shipped_specimens

#: RMS of the identification: vertical in m, lateral and longitudinal in N, left and right; then both brakes in N.
LEVELS: Final = np.array([0.004, 300.0, 300.0] * 2 + [150.0] * 2)
_FORCE: Final = white(*IDENTIFIED)
_SPECTRA: Final = ((DISPLACEMENT, _FORCE, _FORCE) * 2) + (_FORCE, _FORCE)
#: Two realisations of eight experiments with one delay and two captured blocks each.
_EXPERIMENT_SECONDS: Final = 105.0
#: Rows of the longitudinal forces and of the brake moments, left and right.
_LONGITUDINAL, MOMENTS = (2, 5), (6, 7)
#: Tyre force of a stop with each wheel, N; the right one gets less. What a pump adds and takes, and how often, Hz.
_STOP_FORCE, _PULSES, _PULSE_FREQUENCY = (2000.0, 1900.0), 0.25, 6.0
_RISE_SECONDS: Final = 0.15
#: From the wheel's centre to the ground, m.
_ROLLING_RADIUS: Final = 0.32


def spindle_rig(*, braking: bool) -> PlayableRig:
    """Load the spindle-coupled rig, with the two brake actuators or without."""
    return _load("spindle_coupled_braking" if braking else "spindle_coupled")


@cache
def _load(name: str) -> PlayableRig:
    return load_any_rig(shipped_specimens()[name])


@cache
def spindle_model(share: float, *, braking: bool, seed: int) -> RigModel:
    """Identify it at a share of `LEVELS`, line by line: the wheels swing fore and aft more sharply than LPM follows."""
    drives = len(spindle_rig(braking=braking).specimen.drives)
    return identify(
        spindle_rig(braking=braking),
        levels=share * LEVELS[:drives],
        seed=seed,
        spectra=_SPECTRA[:drives],
        seconds=_EXPERIMENT_SECONDS,
        estimator=EstimatorSettings(kind=EstimatorKind.H1, block_samples=AXLE_BLOCK),
    )


def spindle_target(seconds: float, *, potholes: int, stops: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
    """Return spindle forces of the predecessor on the road, and those of stops: from when, how long, in seconds.

    The ground pulls a braked tyre backwards; with the brake closed that force turns the spindle by the rolling radius.
    Without stops there are six rows, with stops eight: a moment for each wheel.
    """
    road = predecessor_target(seconds, potholes=potholes)
    if not stops:
        return road
    time = np.arange(road.shape[1]) / SAMPLE_RATE
    stop = np.zeros_like(time)
    for start, length in stops:
        ramp = np.clip((time - start) / _RISE_SECONDS, 0.0, 1.0)
        ramp *= np.clip((start + length - time) / _RISE_SECONDS, 0.0, 1.0)
        stop += ramp * (1.0 + _PULSES * np.sin(2.0 * np.pi * _PULSE_FREQUENCY * (time - start)))
    force = np.array(_STOP_FORCE)[:, None] * stop
    road[_LONGITUDINAL, :] -= BAND.limit_target(force)
    return np.vstack([road, BAND.limit_target(_ROLLING_RADIUS * force)])
