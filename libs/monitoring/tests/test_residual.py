"""The measures of the residual on records whose change is known."""

from itertools import pairwise

import numpy as np
import pytest

from duralab_monitoring.repeat_statistics import RepeatStatistics
from duralab_monitoring.residual import BandLines, Reference

RATE, SAMPLES = 500.0, 4000
EDGES = (1.0, 5.0, 20.0, 80.0)
TIME = np.arange(SAMPLES) / RATE


def bands():
    return BandLines.of(EDGES, samples=SAMPLES, sample_rate=RATE)


def tones(phase=0.0, delay=0.0):
    """A tone of amplitude 2 in the first band and one of 1 in the second; the other channel has them swapped."""
    slow, fast = (np.sin(2 * np.pi * f * (TIME - delay) + phase) for f in (2.0, 10.0))
    return np.array([2.0 * slow + fast, slow + 2.0 * fast])


def reference_of(*records, commands=0):
    reference = Reference.empty(bands(), channels=records[0].shape[0] - commands, commands=commands)
    for record in records:
        reference.add(record)
    return reference


RMS = np.sqrt(2.5)


def test_the_baseline_itself_has_no_residual():
    measures, lag = reference_of(tones(), tones()).measures(tones())
    np.testing.assert_allclose(measures, 0.0, atol=1e-9)
    assert lag == pytest.approx(0.0, abs=1e-12)


def test_a_gain_is_a_gain_in_the_bands_that_hold_the_signal():
    measures, _ = reference_of(tones()).measures(1.03 * tones())
    _, gain, phase, remainder = np.split(measures, [1, 4, 7], axis=1)
    shares = 0.03 * np.sqrt(0.5) * np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0]]) / RMS
    np.testing.assert_allclose(gain, shares, atol=1e-9)
    np.testing.assert_allclose(phase, 0.0, atol=1e-9)
    np.testing.assert_allclose(remainder**3, 0.0, atol=1e-12)


def test_a_quarter_of_a_period_is_a_phase_and_another_frequency_a_remainder():
    changed = tones()
    changed[0] += 0.01 * np.cos(2 * np.pi * 10.0 * TIME)
    changed[1] += 0.02 * np.sin(2 * np.pi * 40.0 * TIME)
    # The commands hold the start of the record; without them a part of the phase would be a lag.
    record = np.concatenate([tones(), tones()])
    measures, _ = reference_of(record, commands=2).measures(np.concatenate([changed, tones()]))
    assert measures[0, 5] == pytest.approx(0.01 * np.sqrt(0.5) / RMS)
    assert measures[1, 9] ** 3 == pytest.approx((0.02 * np.sqrt(0.5) / RMS) ** 2, rel=1e-3)
    kept = np.delete(measures.ravel(), [5, 10 + 9])
    np.testing.assert_allclose(kept, 0.0, atol=1e-4)


def test_an_offset_is_static():
    measures, _ = reference_of(tones() + 3.0).measures(tones() + np.array([[3.1], [3.0]]))
    assert measures[0, 0] == pytest.approx(0.1 / RMS)
    np.testing.assert_allclose(measures[:, 1:7], 0.0, atol=1e-9)


@pytest.mark.parametrize("delay", [0.0003, -0.0104, 0.08])
def test_a_record_that_begins_late_is_aligned(delay):
    measures, lag = reference_of(tones()).measures(tones(delay=delay))
    assert lag == pytest.approx(delay, abs=1e-9)
    np.testing.assert_allclose(measures[:, :7], 0.0, atol=1e-6)


def test_commands_tell_a_late_specimen_from_a_late_record():
    reference = reference_of(np.concatenate([tones(), tones()]), commands=2)
    late_specimen, lag = reference.measures(np.concatenate([tones(delay=0.001), tones()]))
    assert lag == pytest.approx(0.0, abs=1e-9)
    assert late_specimen[1, 5] == pytest.approx(-2.0 * np.sin(2 * np.pi * 0.01) * np.sqrt(0.5) / RMS, rel=1e-6)
    late_record, lag = reference.measures(np.concatenate([tones(delay=0.001), tones(delay=0.001)]))
    assert lag == pytest.approx(0.001, abs=1e-9)
    np.testing.assert_allclose(late_record[:, :7], 0.0, atol=1e-6)


def test_white_noise_leaves_gain_and_phase_with_the_scatter_that_theory_says():
    reference, random = reference_of(tones()), np.random.default_rng(1)
    measures = np.array(
        [reference.measures(tones() + 0.1 * random.standard_normal((2, SAMPLES)))[0] for _ in range(400)]
    )
    scatter = measures.std(axis=0)
    np.testing.assert_allclose(scatter[:, [1, 2]], 0.1 / RMS / np.sqrt(SAMPLES), rtol=0.15)
    assert np.corrcoef(measures[:, 0, 1], measures[:, 0, 2])[0, 1] == pytest.approx(0.0, abs=0.15)


def test_the_residual_of_a_band_is_the_rms_of_what_changed_there():
    random = np.random.default_rng(2)
    changed = tones() + 0.1 * random.standard_normal((2, SAMPLES))
    measures, _ = reference_of(np.concatenate([tones(), tones()]), commands=2).measures(
        np.concatenate([changed, tones()])
    )
    lines = np.fft.rfft(changed - tones()) / SAMPLES
    frequency = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    residual = RepeatStatistics(table=np.zeros((2, 6)), measures=measures, lag=0.0).residual
    for band, (low, high) in enumerate(pairwise(EDGES)):
        inside = (frequency >= low) & (frequency < high)
        expected = np.sqrt(2.0 * np.sum(np.abs(lines[:, inside]) ** 2, axis=1)) / RMS
        np.testing.assert_allclose(residual[:, 1 + band], expected, rtol=1e-9)


def test_the_mean_of_repeats_that_begin_at_different_times_is_not_blurred():
    reference = reference_of(*(tones(delay=delay) for delay in (0.0, 0.004, -0.004)))
    measures, _ = reference.measures(tones())
    np.testing.assert_allclose(measures[:, :7], 0.0, atol=1e-6)


def test_a_channel_that_does_not_move_is_judged_in_its_own_unit():
    still = np.zeros((1, SAMPLES))
    measures, lag = reference_of(still).measures(still + 0.25)
    assert measures[0, 0] == pytest.approx(0.25)
    assert np.isfinite(measures).all()
    assert lag == 0.0


def test_a_record_that_is_too_short_for_a_band_is_refused():
    with pytest.raises(ValueError, match=r"lasts 0\.4 s, so the band from 1 to 5 Hz has 1 lines; it needs 2"):
        BandLines.of(EDGES, samples=200, sample_rate=RATE)
