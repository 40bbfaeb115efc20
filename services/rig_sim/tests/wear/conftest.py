"""Rigs that wear, loaded once."""

import pytest
from wearing_quarter_car import GAIN, STRUT, TYRE, quarter_car

from rig_sim import load_rig, shipped_specimens


@pytest.fixture(scope="session")
def quarter(tmp_path_factory):
    return load_rig(quarter_car(tmp_path_factory.mktemp("quarter"), TYRE, STRUT, GAIN))


@pytest.fixture(scope="session")
def front_axle_wearing():
    return load_rig(shipped_specimens()["front_axle_wearing"])
