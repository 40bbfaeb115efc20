"""The shipped rigs, loaded once: as they are, and with sensors that do not hiss."""

import dataclasses
import sys
from pathlib import Path

import pytest

from rig_sim import Engine, EngineChoice, load_rig, shipped_specimens

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[2] / "scripts" / "specimens")]


def without_noise(rig):
    responses = tuple(channel.model_copy(update={"noise_rms": 0.0}) for channel in rig.specimen.responses)
    return dataclasses.replace(rig, specimen=rig.specimen.model_copy(update={"responses": responses}))


@pytest.fixture(scope="session")
def front_axle():
    return load_rig(shipped_specimens()["front_axle"])


@pytest.fixture(scope="session")
def front_axle_compliant():
    """The axle whose wheels bear millimetres of lateral stroke; on `front_axle` these pass the limits of force."""
    return load_rig(shipped_specimens()["front_axle_compliant"])


@pytest.fixture(scope="session")
def predecessor():
    return load_rig(shipped_specimens()["predecessor"])


@pytest.fixture(scope="session", params=["front_axle", "predecessor"])
def rig(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def quiet_front_axle(front_axle):
    return without_noise(front_axle)


@pytest.fixture(scope="session")
def quiet_predecessor(predecessor):
    return without_noise(predecessor)


@pytest.fixture(scope="session", params=["quiet_front_axle", "quiet_predecessor"])
def quiet_rig(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def front_axle_by_drake():
    return load_rig(shipped_specimens()["front_axle_compliant"], EngineChoice(engine=Engine.DRAKE))


@pytest.fixture(scope="session")
def predecessor_by_drake():
    return load_rig(shipped_specimens()["predecessor"], EngineChoice(engine=Engine.DRAKE))
