"""Flat tops that are clipped, and those that a coarse converter makes of slow crests."""

import numpy as np
import pytest
from known_plants import resonance
from scipy import signal

from identifier.estimators.record_checks import STEP_SAMPLES, ChannelCheck
from identifier.excitation import ExperimentSettings, design_experiment, white

RATE = 512.0


def slow(seed, *, highest=5.0, samples=50_000):
    """Return noise up to a frequency at 512 Hz, of which the largest magnitude is 1."""
    white = np.random.default_rng(seed).standard_normal(samples)
    record = signal.sosfilt(signal.butter(6, highest, fs=RATE, output="sos"), white)
    return record / np.max(np.abs(record))


def converted(record, *, steps):
    return np.round(record * steps) / steps


def clipped(*records):
    check = ChannelCheck(len(records), name="response", of_drive=False)
    check.add(np.stack(records))
    return [warning.channel for warning in check.warnings()]


@pytest.mark.parametrize("highest", [2.0, 5.0, 20.0])
@pytest.mark.parametrize("steps", [102, 410, 1640, 26_000])
def test_a_slow_crest_on_a_coarse_converter_is_not_clipped(highest, steps):
    """A tenth of the range of 11 bit to four fifths of 16."""
    records = [slow(seed, highest=highest) for seed in range(20)]
    assert clipped(*(converted(record, steps=steps) for record in records)) == []
    noise = 0.2 / steps * np.random.default_rng(9).standard_normal(records[0].size)
    assert clipped(*(converted(record + noise, steps=steps) for record in records)) == []


@pytest.mark.parametrize("steps", [102, 410])
def test_a_multisine_of_low_crest_factor_on_a_coarse_converter_is_not_clipped(steps):
    """Its crests are many, alike and flat."""
    settings = ExperimentSettings(
        drive_spectra=(white(0.5, 5.0),),
        rms=(1.0,),
        duration=200.0,
        block_samples=8192,
        fade=1.0,
        seed=1,
        minimise_crest_factor=True,
    )
    drive = design_experiment(settings, drives=1, sample_rate=RATE).drive
    assert clipped(converted(drive[0] / np.max(np.abs(drive)), steps=steps)) == []


@pytest.mark.parametrize("highest", [5.0, 20.0])
@pytest.mark.parametrize("steps", [127, 410, 2047, 1e9])
@pytest.mark.parametrize("limit", [0.5, 0.8])
def test_a_clipped_signal_is_found_on_a_coarse_converter_too(highest, steps, limit):
    records = [np.clip(slow(seed, highest=highest), -limit, limit) for seed in range(20)]
    assert clipped(*(converted(record, steps=steps) for record in records)) == list(range(20))


@pytest.mark.parametrize("steps", [410, 2047])
def test_an_amplifier_that_gives_way_softly_is_found(steps):
    """Below the limit the levels crowd: the signal comes to it on a round shoulder."""
    records = [0.4 * np.tanh(slow(seed) / 0.1) for seed in range(20)]
    assert clipped(*(converted(record, steps=steps) for record in records)) == list(range(20))


def test_a_channel_that_rests_at_first_is_judged_as_well():
    rest = np.full(STEP_SAMPLES, 0.1)
    assert clipped(np.concatenate([rest, np.minimum(slow(1), 0.5)])) == [0]


@pytest.mark.parametrize("piece", [1, 3, 50])
def test_what_is_rounded_and_what_is_clipped_is_the_same_however_the_record_is_cut(piece):
    fast = signal.lfilter([1.0], resonance(5.0, 0.05), np.random.default_rng(3).standard_normal(4000))
    records = np.stack(
        [
            converted(slow(3, samples=4000), steps=102),
            converted(np.minimum(slow(3, samples=4000), 0.5), steps=102),
            np.maximum(fast / np.max(np.abs(fast)), -0.6),
        ]
    )
    whole, cut = (ChannelCheck(3, name="response", of_drive=False) for _ in range(2))
    whole.add(records)
    for start in range(0, 4000, piece):
        cut.add(records[:, start : start + piece])
    assert [warning.channel for warning in whole.warnings()] == [1, 2]
    assert cut.warnings() == whole.warnings()
