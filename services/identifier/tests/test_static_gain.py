"""The static gain against plants whose gain at rest is known."""

import math
import re

import numpy as np
import pytest
from scipy.signal import lfilter
from test_request_and_model import RIG, multisine, plan

from duralab_settings import SettingsError
from identifier import WarningCode, estimate_experiment
from identifier.bus import settings_of
from identifier.experiment import check_against_rig, measured_static_gain, static_samples, static_warnings
from identifier.modelling import plan_message, valid_band

GAIN = np.array([[4e5, -2e4], [1e4, 3e5], [7e3, 0.0]])
REST = np.array([3600.0, -20.0, 5.0])
RATE = RIG.sample_rate


def lag(drive, seconds):
    """Response of a plant that follows with one time constant."""
    share = 1.0 - np.exp(-1.0 / (seconds * RATE))
    return GAIN @ lfilter([share], [1.0, share - 1.0], drive, axis=1) + REST[:, None]


def measured(hold, *, seconds):
    message = multisine(excitation__static_hold=hold)
    settings, experiment = settings_of(message), plan(message)
    response = lag(experiment.drive, seconds)
    static = measured_static_gain(experiment.drive, response, settings.excitation, sample_rate=RATE)
    samples = experiment.layout.samples
    estimate = estimate_experiment(
        settings.estimator, experiment.layout, drive=experiment.drive[:, :samples], response=response[:, :samples]
    )
    return static, static_warnings(static, estimate, hold=hold)


def test_a_plant_that_settles_has_its_gain_at_rest_whatever_it_carries_there():
    static, warnings = measured(2.0, seconds=0.02)
    np.testing.assert_allclose(static.gain, GAIN, rtol=1e-9, atol=1e-6)
    assert not warnings


def test_a_response_that_had_not_settled_is_reported_and_a_longer_hold_is_the_remedy():
    static, warnings = measured(1.0, seconds=0.5)
    assert {warning.code for warning in warnings} == {WarningCode.STATIC_GAIN}
    assert all("static_hold" in warning.sentence for warning in warnings if "held for 1 s" in warning.sentence)
    assert np.max(static.unsettled) > 0.02
    assert not [warning for warning in measured(8.0, seconds=0.5)[1] if "held for" in warning.sentence]


@pytest.mark.parametrize(
    ("seconds", "change", "share"),
    [(0.8, 0.0318, 0.972), (2.0, 0.188, 0.723), (3.3, 0.301, 0.5), (math.inf, 1.0, None)],
)
def test_a_change_of_30_percent_in_the_used_half_of_a_hold_of_4_s_is_half_of_the_gain_at_rest(seconds, change, share):
    # The largest change that the iterator allows in a band from 0 Hz. Nothing holds the last plant: it rises evenly.
    message = multisine(excitation__static_hold=4.0)
    settings, experiment = settings_of(message), plan(message)
    drive = experiment.drive.copy()
    drive[:, : experiment.layout.samples] = 0.0
    response = GAIN @ np.cumsum(drive, axis=1) / RATE if share is None else lag(drive, seconds)
    static = measured_static_gain(drive, response, settings.excitation, sample_rate=RATE)
    np.testing.assert_allclose(static.unsettled, change, atol=2e-3)
    if share is not None:
        assert static.gain[0, 0] / GAIN[0, 0] == pytest.approx(share, abs=0.02)


def test_a_static_gain_that_does_not_continue_the_frf_is_reported_with_the_lowest_line():
    # 0.98 Hz is far above the corner of a plant with a time constant of 2 s.
    warnings = measured(20.0, seconds=2.0)[1]
    assert any(re.search(r"differs by \d+ % from the FRF at 0\.977 Hz", warning.sentence) for warning in warnings)


def test_each_drive_alone_is_held_at_its_own_largest_value_up_and_down_and_ends_at_rest():
    with_holds, without = plan(multisine(excitation__static_hold=1.0)), plan(multisine())
    samples = without.layout.samples
    np.testing.assert_array_equal(with_holds.drive[:, :samples], without.drive)
    holds = with_holds.drive[:, samples:]
    assert np.all(np.count_nonzero(holds, axis=0) <= 1)
    peak = np.max(np.abs(without.drive), axis=1)
    np.testing.assert_allclose([holds.max(axis=1), holds.min(axis=1)], [peak, -peak])
    assert np.all(holds[:, [0, -1]] == 0.0)
    assert np.all(np.count_nonzero(np.isclose(holds, peak[:, None]), axis=1) >= RATE)


def test_without_holds_the_drive_is_what_it_was_and_nothing_is_measured():
    experiment, settings = plan(multisine()), settings_of(multisine()).excitation
    assert experiment.drive.shape[1] == experiment.layout.samples
    assert static_samples(settings, drives=2, sample_rate=RATE) == 0
    assert measured_static_gain(experiment.drive, lag(experiment.drive, 0.02), settings, sample_rate=RATE) is None


def test_the_plan_counts_the_holds_and_a_rig_that_cannot_play_so_long_refuses_them():
    message = multisine(excitation__static_hold=3.0)
    experiment = plan(message)
    told = plan_message(settings_of(message).excitation, rig=RIG, band=valid_band(experiment.layout))
    assert told.samples == experiment.drive.shape[1]
    assert told.duration_seconds == pytest.approx(experiment.drive.shape[1] / RATE)
    with pytest.raises(
        SettingsError, match=r"and its static holds 604 s; rig 'front_axle' plays at most 600 s\."
    ) as caught:
        check_against_rig(settings_of(multisine(excitation__static_hold=150.0)), RIG)
    assert caught.value.field == "excitation.duration"
