"""Drake plays a worn specimen as the compiled player does: losses are inputs of both."""

import numpy as np

from rig_sim import Engine, EngineChoice, Lost, load_rig, shipped_specimens

LOST = {
    "left_lower_rear_bushing": Lost(stiffness=0.3, damping=0.3),
    "right_tie_rod": Lost(stiffness=0.8, damping=0.8),
    "left_strut_damper": Lost(damping=0.6),
}


def played(rig, drive, lost):
    playback = rig.playback(drive, seed=1, condition=rig.changed(lost))
    for _ in playback.blocks():
        pass
    return playback


def test_drake_and_the_compiled_player_agree_on_a_worn_axle(front_axle_wearing):
    drake = load_rig(shipped_specimens()["front_axle_wearing"], EngineChoice(engine=Engine.DRAKE))
    drive = 1.0 - np.cos(2 * np.pi * 10.0 * np.arange(150) / 1000.0)
    drive = np.array([0.005, 0.0005, 0.001] * 2)[:, None] * drive
    compiled = played(front_axle_wearing, drive, LOST)
    by_drake, as_new = played(drake, drive, LOST), played(drake, drive, {})
    scale = np.abs(compiled.response).max(axis=1)
    # As an axle that is new: 1e-3 of the peaks is what the shipped step may be off.
    assert (np.abs(by_drake.response - compiled.response).max(axis=1) < 1e-3 * scale).all()
    assert (np.abs(by_drake.response - as_new.response).max(axis=1) > 5e-3 * scale)[[0, 1, 2, 4, 5]].all()
    for one, other in zip(by_drake.loads(), compiled.loads(), strict=True):
        assert np.abs(one - other).max() < 2e-3 * np.ptp(other)
