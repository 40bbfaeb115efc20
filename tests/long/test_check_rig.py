"""The rigs that ship keep the contract that a real rig's gateway has to keep."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from duralab.conformance import Finding, Outcome, check_rig
from duralab.processes import Supervisor, lab_services, shipped_rigs
from duralab_bus import Bus, BusConfig, open_bus

RIGS = tuple(shipped_rigs())
#: Shakers have no slew limit, and the modes of a structure no bodies; everything else is tried.
NOT_TRIED = {"aerospace": {"refuse.jump", "play.poses"}}


@pytest.fixture(scope="module")
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bus]:
    """A bus on which rig_sim serves every shipped rig; without a recorder, so that it keeps each block that it sent."""
    folder = tmp_path_factory.mktemp("rigs")
    (rig_sim,) = (plan for plan in lab_services(rigs=RIGS, recordings=folder, viewer=None) if plan.name == "rig_sim")
    with (
        open_bus(BusConfig(listen=("tcp/127.0.0.1:0",)), service="duralab") as opened,
        Supervisor([rig_sim], bus=opened, logs=folder) as supervisor,
    ):
        supervisor.start(timeout_seconds=120.0)
        yield opened


@pytest.fixture(scope="module")
def findings(bus: Bus) -> dict[str, list[Finding]]:
    """What was found on every rig; all at once, since most of it is waiting."""
    with ThreadPoolExecutor(len(RIGS)) as pool:
        # Twice as long as the command plays: all at once, a stop may come later.
        return dict(zip(RIGS, pool.map(lambda rig: check_rig(bus, rig, seconds=4.0), RIGS), strict=True))


def test_all_of_them_are_known() -> None:
    assert {"front_axle", "macpherson", "spindle_coupled", "aerospace", "full_vehicle"} <= set(RIGS)


@pytest.mark.parametrize("rig", RIGS)
def test_a_shipped_rig_keeps_the_contract(findings: dict[str, list[Finding]], rig: str) -> None:
    for finding in findings[rig]:
        sys.stdout.write(f"{rig:<24}{finding.check:<22}{finding.outcome.value:<10}{finding.sentence}\n")
    assert [f for f in findings[rig] if f.outcome is Outcome.FAILED] == []
    not_tried = {finding.check for finding in findings[rig] if finding.outcome is Outcome.NOT_TRIED}
    assert not_tried == NOT_TRIED.get(rig, set())


def test_the_command_prints_a_line_for_each_check(bus: Bus) -> None:
    asked = [sys.executable, "-m", "duralab", "check-rig", "aerospace", "--connect", bus.listening[0]]
    checked = subprocess.run(asked, capture_output=True, text=True, check=False, timeout=180)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    *lines, verdict = checked.stdout.strip().splitlines()
    assert sum(" passed" in line for line in lines) >= 20
    assert verdict.startswith("aerospace keeps the contract: ")
