"""An axle with eighteen sensors and six drives, and targets for all of them from another vehicle or from itself."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import yaml
from low_level_campaigns import BAND, IDENTIFIED, OPERATIONAL, identify, play, predecessor_target
from numpy.typing import NDArray

from duralab_spectra import rms
from iterator import RigModel, rig_model
from rig_sim import PlayableRig, load_any_rig, shipped_specimens


@dataclass(frozen=True)
class Group:
    """Responses of one kind, as rows."""

    name: str
    rows: tuple[int, ...]


FORCES: Final = Group("spindle forces", tuple(range(6)))
ACCELERATIONS: Final = Group("knuckle accelerations", tuple(range(6, 12)))
STRUTS: Final = Group("strut travel", (12, 13))
BUSHINGS: Final = Group("forces of the rear bushings", tuple(range(14, 18)))
GROUPS: Final = (FORCES, ACCELERATIONS, STRUTS, BUSHINGS)
#: Share of the operational drive RMS.
_SHARE: Final = 0.3
_OWN_NOISE: Final = 5000


@cache
def sensor_rig() -> PlayableRig:
    """Load the axle with six drives and eighteen responses."""
    return load_any_rig(shipped_specimens()["front_axle_sensors"])


def predecessor_with_sensors() -> PlayableRig:
    """Return the predecessor with the same sensors, made of both YAMLs."""
    shipped = shipped_specimens()
    said = yaml.safe_load(shipped["front_axle_sensors"].read_text(encoding="utf-8"))
    said |= {"variant_of": "predecessor.yaml", "name": "predecessor_sensors", "title": "Predecessor with sensors"}
    with TemporaryDirectory() as folder:
        for suffix in (".yaml", ".sdf"):
            shutil.copy(shipped["predecessor"].with_suffix(suffix), folder)
        path = Path(folder) / "predecessor_sensors.yaml"
        path.write_text(yaml.safe_dump(said), encoding="utf-8")
        return load_any_rig(path)


def foreign_target(seconds: float, *, potholes: int) -> NDArray[np.float64]:
    """Return what the sensors of the predecessor measure on the road."""
    return predecessor_target(seconds, potholes=potholes, vehicle=predecessor_with_sensors())


def own_target(drive: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the axle itself does with a drive: six drives then reach all eighteen responses."""
    return BAND.limit_response(play(sensor_rig(), drive, seed=_OWN_NOISE))


@cache
def _identified(seed: int) -> RigModel:
    return identify(sensor_rig(), levels=_SHARE * OPERATIONAL, seed=seed)


def weighted_model(target: NDArray[np.float64], controlled: tuple[Group, ...], *, seed: int) -> RigModel:
    """Return the model that controls some groups, each response weighed by one over its target's RMS.

    The first inverse is cautious: it asks less of the drives where sensors hardly see what they do.
    """
    model = _identified(seed)
    weight = np.zeros(target.shape[0])
    for group in controlled:
        weight[list(group.rows)] = 1.0 / rms(target[list(group.rows)])
    return rig_model(
        model.frequency,
        model.frf,
        identified_band=IDENTIFIED,
        response_weight=weight,
        uncertainty=model.uncertainty,
        caution=1.0,
    )


def of_group(errors: NDArray[np.float64], group: Group) -> float:
    """Return the relative RMS error over the responses of a group."""
    return float(np.sqrt(np.mean(errors[list(group.rows)] ** 2)))
