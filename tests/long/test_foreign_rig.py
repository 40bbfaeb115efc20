"""A campaign on a rig that knows nothing of this project but its contract."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import duralab
from duralab.testing import FOREIGN_RIG, foreign_gateway

RATE = 200.0

CAMPAIGN = """
name: stranger
rig: stranger
seed: 7
target: {file: target.csv}
excitation:
  kind: random_orthogonal
  lowest_frequency: 0.5
  highest_frequency: 40.0
  corner_frequency: 40.0
  decibels_per_octave: 0.0
  rms: 0.002
  duration: 60.0
  fade: 1.0
  delay_blocks: 1
  capture_blocks: 2
estimator: {kind: h1, block_samples: 512}
control_band: {lowest_frequency: 1.0, highest_frequency: 30.0}
update: {kind: adaptive_modelling, iteration_gain: 0.8}
stop: {iterations: 4}
accept: {relative_rms_error: 0.05}
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[duralab.Lab]:
    with duralab.start(tmp_path_factory.mktemp("lab"), rigs=("predecessor",)) as lab, foreign_gateway(lab.endpoints[0]):
        lab._bus.wait_for_live({("rig_sim", FOREIGN_RIG)}, 30.0)
        yield lab


def write_target(path: Path) -> None:
    """Forces between 2 and 20 Hz that begin and end at zero, far past where the beam is linear."""
    time = np.arange(4000) / RATE
    generator = np.random.default_rng(3)
    frequency = np.arange(2.0, 20.0, 0.25)
    phase = generator.uniform(0.0, 2.0 * np.pi, (2, frequency.size))
    tones = np.cos(2.0 * np.pi * frequency[:, None] * time + phase[:, :, None]).sum(axis=1)
    forces = 500.0 * tones * np.sin(np.pi * time / time[-1]) ** 2
    rows = np.column_stack([time, *forces])
    np.savetxt(path, rows, delimiter=",", header="time [s],a_force [N],b_force [N]", comments="")


def test_the_iteration_converges_on_a_rig_of_a_stranger(lab: duralab.Lab, tmp_path: Path) -> None:
    write_target(tmp_path / "target.csv")
    file = tmp_path / "stranger.yaml"
    file.write_text(CAMPAIGN)
    activities: list[str] = []
    result = lab.run(file, out=tmp_path / "out", on_progress=lambda progress: activities.append(progress.activity))
    assert result.verdict.judgement is duralab.Judgement.REACHED
    assert len(result.iterations) == 4
    assert result.recording.rig.engine == "somebody's own"
    # What the rig says reaches people: through the identifier, and from each playback.
    for doing in ("identifying", *(f"playing iteration {number} of 4 on" for number in range(1, 5))):
        assert f"{doing} stranger: waiting for the operator to press start" in activities
    # What the gateway published is in the recording, sample by sample, as it answered.
    drive, response = result.recording.signal("stranger.i04")
    playback = result.recording.playback(4)
    np.testing.assert_array_equal(drive.samples, playback.drive.samples)
    np.testing.assert_array_equal(response.samples, playback.response.samples)


def test_the_campaign_that_init_writes_for_it_reaches_its_target(lab: duralab.Lab, tmp_path: Path) -> None:
    file = tmp_path / "stranger_by_init.yaml"
    command = [sys.executable, "-m", "duralab", "init", str(file), "--rig", "stranger", "--connect", lab.endpoints[0]]
    subprocess.run(command, check=True, capture_output=True)
    write_target(tmp_path / "target.csv")
    result = lab.run(file, out=tmp_path / "out")
    assert result.verdict.judgement is duralab.Judgement.REACHED
