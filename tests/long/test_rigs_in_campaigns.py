"""Campaigns on rigs other than the default one, in the lab that `duralab run` would start for each of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import duralab


def test_a_car_is_replicated_by_displacement_and_force_control(tmp_path: Path):
    plan = duralab.load_campaign("spindle_coupled_demo")
    shorter = plan.model_copy(
        update={
            "target": plan.target.model_copy(
                update={"road": plan.target.road.model_copy(update={"duration": 12.0, "potholes": None})}
            ),
            "stop": plan.stop.model_copy(update={"iterations": 3}),
        }
    )
    assert set(plan.rigs) == {"spindle_coupled", "full_vehicle"}
    with duralab.start(tmp_path, rigs=plan.rigs) as lab:
        result = lab.run(shorter)
    errors = result.iterations.relative_rms_error
    # Gains of 0.65, 0.8 and 1: what a linear model does not explain is friction and slip of the rubber.
    assert np.all(errors[-1] <= 0.15)
    assert np.all(np.diff(errors, axis=0) < 0.0)
    # 150 s, quiet at first, then at half of this target of 12 s: 45 passes of it.
    assert np.all(result.iterations.identification_damage[:, 1] < 100.0)


def test_another_suspension_takes_the_same_campaign(campaign, tmp_path: Path):
    plan = duralab.load_campaign(campaign(rig="macpherson_compliant", update__iteration_gain=0.5, stop__iterations=7))
    with duralab.start(tmp_path, rigs=plan.rigs) as lab:
        result = lab.run(plan)
    errors = result.iterations.relative_rms_error
    vertical_and_longitudinal = [0, 2, 3, 5]
    assert np.all(errors[-1, vertical_and_longitudinal] <= 0.1)
    # Lateral has to learn the arc of the wheel's path first, and gets worse while the vertical forces still grow.
    assert np.all(errors[-1] <= 0.25)
