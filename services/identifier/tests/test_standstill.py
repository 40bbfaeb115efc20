"""A sensor that is stuck for a while, and what looks like one."""

import re

import numpy as np
import pytest
from known_plants import RATE, noise_layout, periodic_experiment, respond

from duralab_settings import EstimatorKind, ExcitationKind
from identifier import Estimation, EstimatorOptions, WarningCode, estimate
from identifier.estimators.standstill import StandstillCheck
from identifier.excitation import ExperimentSettings, design_experiment, white


def stuck_warnings(drive, response, layout):
    found = estimate(EstimatorKind.H1, drive, response, layout).warnings
    return [warning for warning in found if warning.code is WarningCode.STUCK]


def design(kind, *, block=1024):
    settings = ExperimentSettings(
        drive_spectra=(white(2.0, 60.0),) * 2,
        rms=(1.0, 1.0),
        duration=40.0,
        block_samples=block,
        fade=0.1,
        seed=6,
        kind=kind,
    )
    return design_experiment(settings, drives=2, sample_rate=RATE)


def converted(record, *, steps):
    """Return the record as a converter gives it whose steps the largest value fills so many of."""
    step = np.max(np.abs(record), axis=1, keepdims=True) / steps
    return np.round(record / step) * step


@pytest.mark.parametrize("kind", list(ExcitationKind))
@pytest.mark.parametrize("share", [0.12, 0.3])
def test_a_response_that_is_stuck_is_named_with_its_time(kind, share):
    experiment = design(kind)
    drive, layout = experiment.drive, experiment.layout
    response = respond(drive)
    start, stop = int(0.4 * layout.samples), int((0.4 + share) * layout.samples)
    response[1, start:stop] = response[1, start]
    (warning,) = stuck_warnings(drive, response, layout)
    assert (warning.channel, warning.of_drive) == (1, False)
    told = re.search(r"Response 1 stands still at (\S+) from (\S+) s to (\S+) s while drives move", warning.sentence)
    assert float(told[1]) == pytest.approx(response[1, start], rel=1e-5)
    # A run is looked at where the record is used: delays and fades at its ends are not.
    unused = (layout.delay_blocks + 1) * layout.block_samples / RATE if layout.periodic else 0.3
    assert float(told[2]) == pytest.approx(start / RATE, abs=unused)
    assert float(told[3]) == pytest.approx(stop / RATE, abs=unused)
    assert 0.5 * share < warning.size < 1.6 * share


@pytest.mark.parametrize(("periods", "named"), [(0.8, False), (1.2, True)])
def test_it_counts_from_one_period_of_the_lowest_frequency_on(periods, named):
    random = np.random.default_rng(2)
    layout = noise_layout(20_000, lowest=8.0)  # the lowest line is at 8.79 Hz
    drive = random.standard_normal((1, 20_000))
    response = 2.0 * drive
    response[0, 5000 : 5000 + round(periods * 1024 / 9)] = 0.7
    assert bool(stuck_warnings(drive, response, layout)) == named


@pytest.mark.parametrize("kind", list(ExcitationKind))
@pytest.mark.parametrize("steps", [3, 20, 127, 2047])
def test_a_coarse_converter_is_no_stuck_sensor(kind, steps):
    experiment = design(kind)
    response = converted(respond(experiment.drive), steps=steps)
    assert stuck_warnings(experiment.drive, response, experiment.layout) == []


def test_a_coarse_accelerometer_does_not_resolve_the_slow_part_of_a_sweep():
    experiment = design(ExcitationKind.SWEPT_SINE, block=4096)
    acceleration = converted(np.gradient(np.gradient(experiment.drive, axis=1), axis=1), steps=5)
    moving = np.flatnonzero(np.any(np.diff(experiment.drive) != 0.0, axis=0))
    changes = np.flatnonzero(np.diff(acceleration[0])[moving] != 0.0)
    assert np.max(np.diff(changes)) > 4096 / 9  # more than a period of the lowest line
    assert stuck_warnings(experiment.drive, acceleration, experiment.layout) == []


def test_a_rig_at_rest_is_not_stuck():
    # Bursts of half a block that have decayed, and a pause of three blocks within one stretch that is used.
    experiment = design(ExcitationKind.BURST_RANDOM)
    response = converted(respond(experiment.drive), steps=127)
    assert stuck_warnings(experiment.drive, response, experiment.layout) == []
    random = np.random.default_rng(2)
    drive = random.standard_normal((2, 20_000))
    drive[:, 8000:11_072] = 0.25
    assert stuck_warnings(drive, 3.0 * drive, noise_layout(20_000)) == []


@pytest.mark.parametrize("piece", [1, 7, 300, 5000])
def test_a_standstill_is_the_same_however_the_record_is_cut(piece):
    drive, layout = periodic_experiment(block=256, periods=3)
    response = converted(respond(drive), steps=20)
    response[0, 3000:] = response[0, 3000]
    response[1, 1100:1700] = response[1, 1100]
    response[2, 1026:1200] = response[2, 1026]
    whole = stuck_warnings(drive, response, layout)
    assert [warning.channel for warning in whole] == [0, 1, 2]
    running = Estimation(EstimatorKind.H1, layout, drives=2, responses=3, options=EstimatorOptions())
    for start in range(0, drive.shape[1], piece):
        running.add(drive[:, start : start + piece], response[:, start : start + piece])
    found = [warning for warning in running.estimate().warnings if warning.code is WarningCode.STUCK]
    assert found == whole


def test_the_value_told_is_the_one_that_was_measured():
    drive, layout = periodic_experiment(block=256)
    check = StandstillCheck(layout, responses=1, taken_off=np.array([3600.0]))
    check.add(drive, np.full((1, drive.shape[1]), 12.5), first=0)
    (warning,) = check.warnings()
    assert "stands still at 3612.5 from 0 s to" in warning.sentence
