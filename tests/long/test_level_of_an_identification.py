"""On the front axle a stroke of 2 or 4 mm RMS is a good level, 17 mm is not, with compliant and with stiff loops."""

import numpy as np
import pytest

from duralab_settings import EstimatorKind, ExcitationKind, WhitePinkSpectrum
from identifier import ExperimentSettings, design_experiment, estimate
from identifier.uncertainty import check_level
from rig_sim import load_any_rig, shipped_specimens

DISPLACEMENT = WhitePinkSpectrum(
    lowest_frequency=0.25, highest_frequency=46.0, corner_frequency=2.0, decibels_per_octave=3.0
)


@pytest.fixture(scope="module", params=["compliant", "stiff"])
def rig(request):
    name = {"compliant": "front_axle_compliant", "stiff": "front_axle"}[request.param]
    return request.param, load_any_rig(shipped_specimens()[name])


@pytest.mark.parametrize("kind", [ExcitationKind.RANDOM_ORTHOGONAL, ExcitationKind.PURE_RANDOM])
@pytest.mark.parametrize(("stroke", "ruined"), [(0.002, False), (0.004, False), (0.017, True)])
def test_only_the_large_stroke_ruins_the_model(rig, kind, stroke, ruined):
    loops, playable = rig
    horizontal = (1e-4, 2e-4) if loops == "stiff" else (0.75 * stroke, 0.25 * stroke)
    periods = {"delay_blocks": 1, "capture_blocks": 2} if kind.is_multisine else {}
    settings = ExperimentSettings(
        kind=kind, drive_spectra=(DISPLACEMENT,) * 6, rms=(stroke, *horizontal) * 2, duration=75.0, fade=1.0, seed=1,
        block_samples=2048, **periods,
    )  # fmt: skip
    experiment = design_experiment(settings, drives=6, sample_rate=1000.0)
    run = playable.playback(np.ascontiguousarray(experiment.drive), seed=1001)
    for _ in run.blocks():
        pass
    response = run.response - np.mean(run.response, axis=1, keepdims=True)
    found = estimate(EstimatorKind.H1, experiment.drive, response, experiment.layout)
    check = check_level(
        lines=found.valid,
        residual_psd=found.unexplained_psd,
        response_psd=found.response_psd,
        random_share=6.0 / np.where(found.valid, found.averages, 1.0),
    )
    assert check.ruined.any() == ruined
    # What is advised from any of them is a stroke of some millimetres.
    assert 0.001 < stroke * check.largest_factor < 0.008
