"""Levels by the pulses of a pre-test: the experiment is quieter than the target, but not far, on stiff rigs too."""

import numpy as np
import pytest

from duralab import Channel, Signals
from duralab.campaign import levels_by_pulses
from duralab.data import PreTest, Rig
from duralab_loads import damage_ratio
from duralab_settings import ExcitationKind, WhitePinkSpectrum
from duralab_spectra import rms
from identifier import ExperimentSettings, design_experiment
from iterator import control_band
from iterator.limits import DriveLimits
from iterator.pre_test.expectation import in_windows, smoothed
from iterator.pre_test.pulses import pulse_train
from rig_sim import load_any_rig, shipped_specimens

RATE = 1000.0
BAND = control_band(0.5, 35.0, sample_rate=RATE)
#: As `duralab init` writes it.
SPECTRUM = WhitePinkSpectrum(
    lowest_frequency=0.25, highest_frequency=45.0, corner_frequency=1.0, decibels_per_octave=6.0
)
SIZES = np.array([600.0, 130.0, 160.0] * 2)


def played(rig, drive, *, seed):
    run = rig.playback(np.ascontiguousarray(drive), seed=seed)
    for _ in run.blocks():
        pass
    return run.response


def channels(described):
    return tuple(
        Channel(one.name, one.unit, minimum=one.minimum, maximum=one.maximum, slew_limit=one.slew_limit)
        for one in described
    )


@pytest.mark.parametrize("level", [0.005, 0.02])
@pytest.mark.parametrize("name", ["front_axle", "macpherson", "macpherson_compliant", "spindle_coupled"])
def test_the_experiment_is_quieter_than_the_target_but_not_far(name, level):
    rig = load_any_rig(shipped_specimens()[name])
    drives = channels(rig.specimen.drives)
    responses = tuple(Channel(one.name, one.unit) for one in rig.specimen.responses)
    described = Rig(name, "", "", "1", RATE, drives, responses, 600.0, rig.static_response, "")
    limits = DriveLimits(
        tuple(one.name for one in drives),
        tuple(one.unit for one in drives),
        *(np.array([getattr(one, of) for one in drives]) for of in ("minimum", "maximum", "slew_limit")),
        RATE,
    )
    train = pulse_train(limits, sample_rate=RATE, level=level)
    answer = played(rig, train.drive, seed=3)
    moved = smoothed(answer - answer[:, : train.rest].mean(axis=1, keepdims=True), RATE)
    peak = np.abs(in_windows(moved, train)).max(axis=2)
    rest = np.zeros(len(responses))
    found = PreTest("", name, True, (), (), drives, responses, train.amplitude, rest, rest, peak, rest, rest)

    noise = BAND.limit_target(np.random.default_rng(7).standard_normal((6, 30_000)))
    target = noise * (SIZES / rms(noise))[:, None]
    levels = levels_by_pulses(found, rig=described, target=Signals(responses, RATE, target), band=(0.5, 35.0))
    settings = ExperimentSettings(
        kind=ExcitationKind.RANDOM_ORTHOGONAL, drive_spectra=(SPECTRUM,) * 6, rms=tuple(levels.rms.values()),
        duration=75.0, fade=1.0, seed=1, block_samples=2048, delay_blocks=1, capture_blocks=2,
    )  # fmt: skip
    experiment = design_experiment(settings, drives=6, sample_rate=RATE)
    response = BAND.limit_target(played(rig, experiment.drive, seed=9) - rig.static_response[:, None])
    share = rms(response) / SIZES
    assert 0.3 < share.max() < 1.1
    assert damage_ratio(target, response)[:, 1].max() < 10.0
