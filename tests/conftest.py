"""Real labs for tests across services: four processes on loopback, started once per module."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import yaml

import duralab

RIGS = ("front_axle", "front_axle_compliant", "predecessor")

# What tests of this folder share lies beside them.
# The browser and its protocol are those of the report's tests.
sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "duralab" / "tests")]


@pytest.fixture(scope="session", autouse=True)
def no_lab_of_the_user(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let no test see, or end, a lab that whoever runs the tests keeps running."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="module")
def short_document() -> dict[str, Any]:
    """The shipped demo campaign on the compliant rig, cut down to a few seconds of everything, read anew per module."""
    shipped = Path(duralab.__file__).with_name("campaign") / "shipped" / "front_axle_demo.yaml"
    document = yaml.safe_load(shipped.read_text())
    # Converges without a drive map.
    document["rig"] = "front_axle_compliant"
    document["excitation"]["rms"] = dict(zip(document["excitation"]["rms"], [0.004, 0.003, 0.001] * 2, strict=True))
    document["target"]["road"].update(duration=12.0, potholes={"count": 1, "depth": [0.02, 0.03], "length": [0.4, 0.8]})
    document["excitation"]["duration"] = 40.0
    del document["excitation"]["at_target"]
    document["stop"]["iterations"] = 3
    return document


@pytest.fixture
def campaign(tmp_path: Path, short_document: dict[str, Any]) -> Callable[..., Path]:
    """Write a short campaign with changes, `__` between the levels of a key, and return its path."""

    def write(**changes: Any) -> Path:
        document = deepcopy(short_document)
        for keys, value in changes.items():
            *parents, key = keys.split("__")
            part = document
            for parent in parents:
                part = part[parent]
            part[key] = value
        path = tmp_path / "campaign.yaml"
        path.write_text(yaml.safe_dump(document))
        return path

    return write


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[duralab.Lab]:
    """A lab of four service processes for one module."""
    with duralab.start(tmp_path_factory.mktemp("lab"), rigs=RIGS) as started:
        yield started
