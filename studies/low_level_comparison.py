"""All updates on the front axle identified at a twentieth of its operational level: what figures 7, 8 and 9 show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from low_level_campaigns import BAND, LONGITUDINAL, OPERATIONAL, Trial, campaign, identified, predecessor_target
from numpy.typing import NDArray
from study_page import percent

from duralab_settings import UpdateKind
from iterator import RigModel, UpdateSettings


@dataclass(frozen=True)
class Algorithm:
    """A row of the tables; those with a colour are drawn."""

    name: str
    settings: UpdateSettings
    colour: str = ""


@dataclass(frozen=True)
class Extent:
    """Extent of the study: seconds of road, potholes, playbacks, and the values in the table of levels."""

    seconds: float
    potholes: int
    playbacks: int
    told: tuple[int, ...]
    shares: tuple[float, ...]
    gains: tuple[float, ...]
    seeds: tuple[int, ...]


FULL: Final = Extent(30.0, 4, 7, (1, 4, 7), (0.05, 0.1, 0.15), (0.5, 0.8, 1.0), (1, 2))
QUICK: Final = Extent(6.0, 1, 2, (1, 2), (0.1,), (0.6,), (1,))
#: Of the operational drive RMS, in the figures.
SHARE: Final = 0.05
CHANNELS: Final = tuple(
    f"{side} {axis}" for side in ("left", "right") for axis in ("vertical", "lateral", "longitudinal")
)
#: The gain 1 of every response, and the fixed gain of what does not learn how far to trust its model.
ONE: Final = np.ones(OPERATIONAL.size)
FIXED: Final = 0.8 * ONE
#: Without the safeguards, as in the paper.
UNGUARDED: Final = {
    "smallest_correction": 1e-6,
    "largest_correction": 1e6,
    "weigh_by_coherence": False,
    "smooth_lines": False,
}
_TWR, _AM, _SECANT = UpdateKind.BASIC_TWR, UpdateKind.ADAPTIVE_MODELLING, UpdateKind.SECANT

BASIC_TWR: Final = Algorithm("basic TWR", UpdateSettings(band=BAND, iteration_gain=FIXED, kind=_TWR), "#c0562a")
ADAPTIVE: Final = Algorithm("Adaptive Modelling", UpdateSettings(band=BAND, iteration_gain=FIXED, kind=_AM), "#3d8b4f")
SECANT: Final = Algorithm(
    "secant update, segment acceptance",
    UpdateSettings(band=BAND, iteration_gain=ONE, kind=_SECANT, accept_segments=True),
    "#1b5e9b",
)
DRAWN: Final = (BASIC_TWR, ADAPTIVE, SECANT)
ALGORITHMS: Final = (
    *DRAWN,
    Algorithm(
        "plain Adaptive Modelling, no safeguards",
        UpdateSettings(band=BAND, iteration_gain=FIXED, kind=_AM, **UNGUARDED),
    ),
    Algorithm(
        "Adaptive Modelling, segment acceptance",
        UpdateSettings(band=BAND, iteration_gain=FIXED, kind=_AM, accept_segments=True),
    ),
    Algorithm(
        "basic TWR, segment acceptance",
        UpdateSettings(band=BAND, iteration_gain=FIXED, kind=_TWR, accept_segments=True),
    ),
    Algorithm(
        "secant update without squares, segment acceptance",
        UpdateSettings(band=BAND, iteration_gain=ONE, kind=_SECANT, squares=False, accept_segments=True),
    ),
    Algorithm(
        "secant update, gain 0.7 to 1, segment acceptance",
        UpdateSettings(
            band=BAND, iteration_gain=ONE, kind=_SECANT, accept_segments=True, gain_schedule=(0.7, 0.8, 0.9, 1.0)
        ),
    ),
)


@cache
def target_of(extent: Extent) -> NDArray[np.float64]:
    """Return the target, measured once for all figures."""
    return predecessor_target(extent.seconds, potholes=extent.potholes)


def model_of(extent: Extent) -> RigModel:
    """Return the model that all algorithms start from."""
    return identified(SHARE, extent.seeds[0])


def operational_model(extent: Extent) -> RigModel:
    """Return the model of the level that the target needs, which represents the rig."""
    return identified(1.0, extent.seeds[0])


@cache
def trial_of(number: int, extent: Extent) -> Trial:
    """Return what the algorithm of that place in `ALGORITHMS` made of the target, played once for all figures."""
    return campaign(
        target_of(extent), model=model_of(extent), update=ALGORITHMS[number].settings, playbacks=extent.playbacks
    )


def drawn_trials(extent: Extent) -> list[tuple[Algorithm, Trial]]:
    """Return the algorithms that are drawn with what they made of the target."""
    return [(algorithm, trial_of(number, extent)) for number, algorithm in enumerate(DRAWN)]


def worst_channel(extent: Extent) -> int:
    """Return the longitudinal response that basic TWR leaves worst."""
    return max(LONGITUDINAL, key=lambda row: trial_of(0, extent).error[-1, row])


def error_after(trial: Trial, playbacks: int) -> str:
    """Return the error over all channels after a number of playbacks, a dash if it ended before."""
    return percent(float(trial.overall[playbacks - 1])) if playbacks <= trial.overall.size else "–"
