"""A specimen that has worn is brought back to its errors: a new campaign, from the present drive and the old model."""

import importlib
from pathlib import Path

import numpy as np

from duralab_settings import LimitPolicy, StopCriteria
from iterator import NO_BOUNDS, CampaignSettings, RecordedPlayback, iterate
from rig_sim import Lost

STUDIES = Path(__file__).resolve().parents[2] / "studies"
RIG = "front_axle_wearing"


def test_three_playbacks_bring_a_soft_bushing_back_to_its_errors(monkeypatch):
    monkeypatch.syspath_prepend(str(STUDIES))
    stiff, low = importlib.import_module("stiff_rig"), importlib.import_module("low_level_campaigns")
    target = low.predecessor_target(10.0, potholes=1, depth_m=(0.02, 0.04), band=stiff.BAND)
    identified = stiff.identify_mapped(
        RIG, 1.0 / np.std(target, axis=1), level=stiff.LEVEL, seconds=75.0, seed=1
    ).learned
    rig = stiff.rig(RIG)

    def campaign(condition, playbacks, *, recorded=(), seed):
        seeds = iter(range(seed, seed + playbacks))

        def play(drive):
            playback = rig.playback(drive, seed=next(seeds), condition=condition)
            for _ in playback.blocks():
                pass
            return playback.response

        settings = CampaignSettings(
            update=stiff.SECANT,
            stop=StopCriteria(iterations=playbacks, **NO_BOUNDS),
            limit_policy=LimitPolicy.PROJECT,
            largest_overrun=low.LARGEST_OVERRUN,
        )
        return list(
            iterate(
                play,
                target,
                model=identified.model,
                settings=settings,
                limits=low.limits_of(rig),
                recorded=recorded,
                drive_map=identified.drive_map,
            )
        )

    def error(step):
        return float(step.metrics.overall_relative_rms_error)

    best = min(campaign(rig.changed(), 8, seed=2000), key=error)
    worn = rig.changed({"left_lower_rear_bushing": Lost(stiffness=0.1, damping=0.1)})
    repeat = rig.playback(best.drive, seed=3000, condition=worn)
    for _ in repeat.blocks():
        pass
    # The repeat in which it was noticed is the first playback of the new campaign; three are played.
    recorded = (RecordedPlayback(drive=best.drive, response=repeat.response),)
    noticed, *again = campaign(worn, 4, recorded=recorded, seed=3001)
    assert error(noticed) > 1.5 * error(best)
    assert min(error(step) for step in again) <= 1.1 * error(best)
