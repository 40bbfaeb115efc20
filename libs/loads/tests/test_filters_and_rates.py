import numpy as np
import pytest

from duralab_loads import FilterKind, filter_zero_phase, remove_drift, remove_mean, resample

RATE = 1000.0


def tone(frequency, *, samples=8000, rate=RATE, phase=0.4):
    return np.sin(2 * np.pi * frequency * np.arange(samples) / rate + phase)[np.newaxis]


def gain_at(frequency, **settings):
    """Amplitude and phase of a filter, from a tone in the middle of a record."""
    middle = slice(2000, 6000)
    carrier = np.exp(-2j * np.pi * frequency * np.arange(8000) / RATE)[middle]
    before, after = tone(frequency), filter_zero_phase(tone(frequency), sample_rate=RATE, **settings)
    return (after[0, middle] @ carrier) / (before[0, middle] @ carrier)


@pytest.mark.parametrize("order", [1, 4, 8])
@pytest.mark.parametrize("frequency", [5.0, 20.0, 40.0, 60.0])
def test_a_low_pass_filter_has_the_gain_of_two_butterworth_passes_and_no_phase(order, frequency):
    ratio = np.tan(np.pi * frequency / RATE) / np.tan(np.pi * 40.0 / RATE)
    expected = 1.0 / (1.0 + ratio ** (2 * order))
    gain = gain_at(frequency, kind=FilterKind.LOW_PASS, corners=[40.0], order=order)
    assert abs(gain - expected) < 1e-6


def test_a_high_pass_filter_has_what_the_low_pass_filter_lacks():
    # In power of one pass, |L|^2 + |H|^2 = 1: the gains of both passes add up to 1.
    for frequency in (10.0, 30.0, 80.0):
        low = gain_at(frequency, kind=FilterKind.LOW_PASS, corners=[30.0])
        high = gain_at(frequency, kind=FilterKind.HIGH_PASS, corners=[30.0])
        assert abs(low + high - 1.0) < 1e-6


def test_a_band_passes_and_the_same_band_stops():
    for frequency, passed in ((20.0, 1.0), (10.0, 0.5), (40.0, 0.5), (2.0, 0.0), (200.0, 0.0)):
        assert abs(gain_at(frequency, kind=FilterKind.BAND_PASS, corners=[10.0, 40.0]) - passed) < 2e-3
        assert abs(gain_at(frequency, kind=FilterKind.BAND_STOP, corners=[10.0, 40.0]) - (1.0 - passed)) < 2e-3


def test_filtering_a_record_backward_is_filtering_it_and_turning_it():
    record = np.random.default_rng(1).standard_normal((2, 4000))
    settings = {"sample_rate": RATE, "kind": FilterKind.BAND_PASS, "corners": [1.0, 50.0]}
    np.testing.assert_allclose(
        filter_zero_phase(record[:, ::-1], **settings)[:, 1000:3000],
        filter_zero_phase(record, **settings)[:, ::-1][:, 1000:3000],
        atol=2e-3,
    )


def test_a_slow_high_pass_filter_settles_within_the_record():
    # Only the offset and the ramp lie below 0.05 Hz; both are odd about the ends and leave nothing there.
    time = np.arange(60_000) / RATE
    filtered = filter_zero_phase(
        (4000.0 + 10.0 * time + np.sin(2 * np.pi * 5.0 * time))[np.newaxis],
        sample_rate=RATE,
        kind=FilterKind.HIGH_PASS,
        corners=[0.05],
        order=2,
    )
    assert np.abs(filtered - np.sin(2 * np.pi * 5.0 * time)).max() < 0.05


def test_a_record_must_last_longer_than_a_filter_takes_to_settle():
    settings = {"sample_rate": RATE, "kind": FilterKind.HIGH_PASS, "corners": [0.5]}
    with pytest.raises(ValueError, match=r"takes 5\.75 s to settle and the record lasts 5\.75 s"):
        filter_zero_phase(np.ones((1, 5746)), **settings)
    assert np.abs(filter_zero_phase(np.ones((1, 5747)), **settings)).max() < 1e-9


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"kind": FilterKind.LOW_PASS, "corners": [500.0]}, "500 Hz; each must be above 0 and below 500 Hz"),
        ({"kind": FilterKind.LOW_PASS, "corners": [1.0, 2.0]}, "has 1 corners and was given 2"),
        ({"kind": FilterKind.BAND_PASS, "corners": [40.0, 10.0]}, "from 40 to 10 Hz; the first must be lower"),
        ({"kind": FilterKind.LOW_PASS, "corners": [5.0], "order": 13}, "order is 13; it must be 1 to 12"),
        ({"kind": FilterKind.HIGH_PASS, "corners": [0.5]}, r"takes 5\.75 s to settle and the record lasts 0\.05 s;"),
        ({"kind": FilterKind.HIGH_PASS, "corners": [1e-9]}, r"takes 6\.91e\+06 s to settle"),
    ],
)
def test_a_filter_that_cannot_be_is_refused(settings, sentence):
    with pytest.raises(ValueError, match=sentence):
        filter_zero_phase(np.ones((1, 50)), sample_rate=RATE, **settings)


@pytest.mark.parametrize(("old", "new"), [(1000.0, 2048.0), (2048.0, 1000.0), (409.6, 1000.0), (500.0, 1000.0)])
@pytest.mark.parametrize("share", [0.1, 0.6, 0.86])
def test_a_tone_is_the_same_tone_at_another_rate(old, new, share):
    frequency = share * 0.5 * min(old, new)
    samples = 4000
    given = tone(frequency, samples=samples, rate=old)
    result = resample(given, sample_rate=old, new_rate=new)
    assert result.shape == (1, int(np.ceil(samples * new / old - 1e-9)))
    expected = tone(frequency, samples=result.shape[1], rate=new)
    inner = slice(int(70 * max(new / old, 1.0)), -int(70 * max(new / old, 1.0)))
    assert np.abs(result - expected)[:, inner].max() < 2e-6


def test_a_tone_above_half_the_new_rate_is_removed_and_not_folded():
    result = resample(tone(320.0, samples=6000), sample_rate=RATE, new_rate=500.0)
    assert np.abs(result[:, 100:-100]).max() < 2e-6


def test_there_and_back_a_band_limited_record_is_itself():
    spectrum = np.zeros((2, 2001), dtype=complex)
    spectrum[:, 1:800] = np.random.default_rng(2).standard_normal((2, 799)) * np.exp(1j * np.arange(799))
    record = np.fft.irfft(spectrum) * 1e3
    there = resample(record, sample_rate=RATE, new_rate=1024.0)
    back = resample(there, sample_rate=1024.0, new_rate=RATE)
    assert np.abs(back[:, :4000] - record)[:, 200:-200].max() < 1e-5 * np.abs(record).max()
    ramp = np.arange(300.0)[np.newaxis]
    np.testing.assert_allclose(resample(ramp, sample_rate=RATE, new_rate=2000.0)[0], np.arange(600) / 2, atol=1e-3)


def test_a_rate_as_a_file_rounds_it_is_taken_and_one_without_a_ratio_refused():
    record = np.ones((1, 300))
    assert resample(record, sample_rate=1.0 / 0.0048828125, new_rate=RATE).shape[1] == 1465
    assert resample(record, sample_rate=1.0 / 0.00333333333, new_rate=RATE).shape[1] == 1000
    with pytest.raises(ValueError, match="no ratio of whole numbers up to 2000"):
        resample(record, sample_rate=RATE, new_rate=1000.1)
    with pytest.raises(ValueError, match="no ratio"):
        resample(record, sample_rate=RATE, new_rate=1e9)


@pytest.mark.parametrize("order", [1, 3])
def test_a_polynomial_drift_goes_and_the_mean_stays(order):
    time = np.linspace(0.0, 1.0, 5001)
    load = np.random.default_rng(3).standard_normal((2, 5001))
    drift = 1e4 * np.stack([time**order, 1.0 - time**order])
    drifting, alone = remove_drift(load + drift, order=order), remove_drift(load, order=order)
    np.testing.assert_allclose(drifting - drifting.mean(axis=1, keepdims=True),
                               alone - alone.mean(axis=1, keepdims=True), atol=1e-7)  # fmt: skip
    np.testing.assert_allclose(drifting.mean(axis=1), (load + drift).mean(axis=1), rtol=1e-9)
    np.testing.assert_allclose(remove_drift(drifting, order=order), drifting, atol=1e-7)
    assert np.abs(remove_mean(drifting).mean(axis=1)).max() < 1e-9


def test_a_drift_that_cannot_be_fitted_is_refused():
    with pytest.raises(ValueError, match="order of the drift is 10"):
        remove_drift(np.ones((1, 50)), order=10)
    with pytest.raises(ValueError, match="needs more than that"):
        remove_drift(np.ones((1, 2)), order=2)
