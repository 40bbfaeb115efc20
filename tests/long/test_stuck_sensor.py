"""A sensor of a shipped rig that sticks in the course of an iteration: it is noticed before a drive answers to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from duralab_settings import EstimatorKind, ExcitationKind, StopCriteria, UpdateKind, WhitePinkSpectrum
from identifier import EstimatorOptions, ExperimentSettings, design_experiment, estimate, pure_random
from identifier.modelling import fill_lines, valid_band
from iterator import CampaignSettings, Outcome, RigModel, UpdateSettings, control_band, rig_model, run_campaign
from rig_sim import Rig, load_rig, shipped_specimens
from rig_sim.playing import FaultKind, StuckSensor

CHANNEL = "left_lateral"
SPECTRA = (
    WhitePinkSpectrum(lowest_frequency=0.4, highest_frequency=45.0, corner_frequency=2.0, decibels_per_octave=3.0),
) * 6


def played(rig: Rig, drive: NDArray[np.float64], *, seed: int = 1) -> NDArray[np.float64]:
    playback = rig.playback(drive, seed=seed)
    for part in (playback.approach(), playback.blocks()):
        for _ in part:
            pass
    return playback.response


def identified(rig: Rig) -> RigModel:
    experiment = design_experiment(
        ExperimentSettings(
            drive_spectra=SPECTRA,
            rms=(0.004, 0.003, 0.001, 0.004, 0.003, 0.001),
            block_samples=2048,
            fade=1.0,
            kind=ExcitationKind.RANDOM_ORTHOGONAL,
            duration=75.0,
            seed=1,
        ),
        drives=6,
        sample_rate=1000.0,
    )
    response = played(rig, experiment.drive)
    response -= response.mean(axis=1, keepdims=True)
    found = estimate(
        EstimatorKind.LOCAL_POLYNOMIAL,
        experiment.drive,
        response,
        experiment.layout,
        EstimatorOptions(half_width=6),
    )
    band = valid_band(experiment.layout)
    return rig_model(found.frequency, fill_lines(found).frf, identified_band=(band.lowest, band.highest))


def test_the_shipped_rigs_stuck_sensor_ends_the_iteration_at_its_first_playback_with_it() -> None:
    path = shipped_specimens()["front_axle_compliant"]
    good = load_rig(path)
    bad = load_rig(path, faults=[StuckSensor(kind=FaultKind.STUCK_SENSOR, channel=CHANNEL, start=4.0)])
    # A target that the rig reaches: its response to other noise.
    rms = (0.008, 0.006, 0.002, 0.008, 0.006, 0.002)
    noise = pure_random(SPECTRA, rms=rms, samples=10_001, fade_samples=2000, sample_rate=1000.0, seed=9)
    target, playbacks = played(good, noise, seed=2), []

    def play(drive: NDArray[np.float64]) -> NDArray[np.float64]:
        playbacks.append(drive)
        return played(good if len(playbacks) < 3 else bad, drive, seed=3)

    band = control_band(0.7, 35.0, sample_rate=1000.0)
    update = UpdateSettings(band=band, iteration_gain=np.full(6, 0.8), kind=UpdateKind.SECANT)
    settings = CampaignSettings(update=update, stop=StopCriteria(iterations=7, divergence_ratio=3.0))
    result = run_campaign(play, target, model=identified(good), settings=settings)
    assert (result.outcome, len(playbacks)) == (Outcome.RESPONSE_STOOD_STILL, 3)
    assert [iteration.stood_still for iteration in result.iterations[:-1]] == [(), ()]
    (found,) = result.iterations[-1].stood_still
    assert good.specimen.responses[found.response].name == CHANNEL
    assert (found.segment.start, found.segment.end) == (4.0, 10.001)
