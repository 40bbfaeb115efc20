"""The rigs that ship keep the contract that a real rig's gateway has to keep."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

import duralab
from duralab.conformance import Finding, Outcome, check_rig
from duralab.lab import join_bus
from duralab.processes import shipped_rigs

RIGS = tuple(shipped_rigs())
#: Shakers have no slew limit, and the modes of a structure no bodies; everything else is tried.
NOT_TRIED = {"aerospace": {"refuse.jump", "play.poses"}}


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[duralab.Lab]:
    """One lab whose rig_sim serves every shipped rig."""
    with duralab.start(tmp_path_factory.mktemp("lab"), rigs=RIGS) as started:
        yield started


@pytest.fixture(scope="module")
def findings(lab: duralab.Lab) -> dict[str, list[Finding]]:
    """What was found on every rig; all at once, since most of it is waiting."""
    with join_bus(lab.endpoints[0]) as bus:
        bus.wait_for_live({("rig_sim", rig) for rig in RIGS}, 120.0)
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


def test_the_command_prints_a_line_for_each_check(lab: duralab.Lab) -> None:
    asked = [sys.executable, "-m", "duralab", "check-rig", "aerospace", "--connect", lab.endpoints[0]]
    checked = subprocess.run(asked, capture_output=True, text=True, check=False, timeout=180)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    *lines, verdict = checked.stdout.strip().splitlines()
    assert sum(" passed" in line for line in lines) >= 20
    assert verdict.startswith("aerospace keeps the contract: ")
