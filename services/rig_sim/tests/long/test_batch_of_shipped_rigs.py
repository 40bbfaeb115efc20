"""Shipped rigs play together as alone: with their mirrors, valves, rubber and wear."""

import numpy as np
import pytest

from rig_sim import Lost, load_rig, play_batch, shipped_specimens


def noise(rig, seed, *, share=0.03, samples=3000):
    """Return noise of a small share of each channel's limit, below 20 Hz; speeds are constant."""
    random = np.random.default_rng(seed)
    rows = []
    for channel in rig.specimen.drives:
        lines = np.fft.rfft(random.standard_normal(samples)) * (np.fft.rfftfreq(samples, 1e-3) < 20.0)
        row = np.fft.irfft(lines, n=samples)
        size = share * min(channel.maximum, -channel.minimum) if channel.minimum < 0.0 else 0.0
        rows.append(np.full(samples, 15.0) if channel.unit == "m/s" else size * row / row.std())
    return np.array(rows)


@pytest.mark.parametrize("name", ["front_axle_wearing", "predecessor"])
def test_a_rig_plays_as_alone_with_any_drive_seed_and_wear(name):
    rig = load_rig(shipped_specimens()[name])
    parts = [part.name for part in rig.model.assembly.wearing]
    worn = [rig.changed({part: Lost(damping=0.3)}) for part in parts[:2]] or [None, None]

    def made():
        conditions = [None, *worn, None, None]
        return [
            rig.playback(noise(rig, seed), seed=seed, condition=condition) for seed, condition in enumerate(conditions)
        ]

    together, alone = made(), made()
    assert play_batch(together) == [None] * 5
    for played, expected in zip(together, alone, strict=True):
        for _ in expected.blocks():
            pass
        motion = expected.response - expected.response.mean(axis=1, keepdims=True)
        error = np.sqrt(np.mean((played.response - expected.response) ** 2, axis=1))
        assert (error < 1e-8 * np.sqrt(np.mean(motion**2, axis=1))).all()
        np.testing.assert_allclose(played.positions, expected.positions, rtol=1e-7, atol=1e-10)
