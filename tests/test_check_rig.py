"""The rigs that ship keep the contract that a real rig's gateway has to keep."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import duralab


@pytest.mark.parametrize("rig", ["front_axle", "predecessor"])
def test_a_shipped_rig_keeps_the_contract(lab: duralab.Lab, rig: str):
    asked = [sys.executable, "-m", "duralab", "check-rig", rig, "--connect", lab.endpoints[0], "--json"]
    checked = subprocess.run(asked, capture_output=True, text=True, check=False, timeout=60)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    findings = json.loads(checked.stdout)["findings"]
    # A road has no slew limit; everything else is tried.
    not_tried = {finding["check"] for finding in findings if finding["outcome"] != "passed"}
    assert not_tried == ({"refuse.jump"} if rig == "predecessor" else set())
