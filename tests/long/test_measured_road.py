"""A measured road as the target's source: the Belgian block, where its file is at hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

ROAD = Path(__file__).resolve().parents[3] / "shared" / "data" / "belgian_block.crg"


@pytest.mark.skipif(not ROAD.exists(), reason="the measured road lies beside the project, not in it; it is not here")
def test_a_measured_belgian_block_is_replicated(lab, campaign, tmp_path: Path):
    target = {"opencrg": {"path": str(ROAD), "duration": 12.0}, "vehicle": "predecessor", "speed": 5.0}
    result = lab.run(campaign(target=target, update__iteration_gain=0.5), out=tmp_path / "out")
    errors = result.iterations.relative_rms_error
    # Vertical and longitudinal follow a gain of 0.5 at once; lateral has to learn the arc of the wheel's path first.
    assert np.all(errors[-1, [0, 2, 3, 5]] <= 0.3)
    assert np.all(errors[-1] <= 0.9 * errors[0])
