import numpy as np
import pytest
from scipy import signal

from duralab_loads import remove_spikes

RATE = 1000.0


def band_limited(highest, *, seed, samples=20_000):
    noise = np.random.default_rng(seed).standard_normal(samples)
    return signal.sosfiltfilt(signal.butter(4, highest, output="sos", fs=RATE), noise)


def potholes(samples=20_000):
    """Rest, then an impact of 10 ms, ringing at 12 Hz; three times, one of them alone on smooth ground."""
    time = np.arange(samples) / RATE
    load = np.zeros(samples)
    for start in (3.0, 8.0, 8.4):
        since = time - start
        load += np.where((since >= 0) & (since < 0.01), np.sin(np.pi * since / 0.01), 0.0) * 9e3
        load += np.where(since >= 0.01, np.exp(-4 * since) * np.sin(2 * np.pi * 12 * (since - 0.01)), 0.0) * 3e3
    return load


def hammer_blows():
    """Ring at 200 Hz from one sample to the next, and have died out 100 ms later."""
    load = 0.01 * np.random.default_rng(7).standard_normal(20_000)
    since = np.arange(1000) / RATE
    for start in (3000, 7000, 11_500, 15_000):
        load[start : start + 1000] += np.exp(-since / 0.02) * np.sin(2 * np.pi * 200.0 * since)
    return load


def rattling(length):
    """White noise that begins at once, 200 times louder than what lies between."""
    rng = np.random.default_rng(13)
    load = 0.005 * rng.standard_normal(20_000)
    for start in range(1000, 19_000, 1500):
        load[start : start + length] += rng.standard_normal(length)
    return load


CLEAN = {
    "white noise": np.random.default_rng(1).standard_normal(20_000),
    "noise up to 40 Hz": band_limited(40.0, seed=2),
    "noise that comes in bursts": band_limited(100.0, seed=3) * (np.arange(20_000) // 2000 % 2),
    "a tone": np.sin(2 * np.pi * 13.0 * np.arange(20_000) / RATE),
    "a tone near half the rate": np.sin(2 * np.pi * 470.0 * np.arange(20_000) / RATE),
    "hammer blows on a quiet floor": hammer_blows(),
    "rattling for 40 ms": rattling(40),
    "rattling for 400 ms": rattling(400),
    "ramps of three samples": np.convolve(np.repeat([0.0, 5.0, 1.0, 8.0], 5000), np.ones(3) / 3, mode="same"),
    "steps": np.repeat([0.0, 5.0, 1.0, 8.0], 5000),
    "potholes on smooth ground": potholes(),
    "potholes on a rough road": potholes() + 300.0 * band_limited(30.0, seed=4),
    "nothing": np.zeros(20_000),
    "a sweep": signal.chirp(np.arange(20_000) / RATE, 0.5, 20.0, 200.0),
}


@pytest.mark.parametrize("longest", [1, 3])
@pytest.mark.parametrize("name", CLEAN)
def test_a_clean_load_is_left_alone(name, longest):
    result = remove_spikes(CLEAN[name][np.newaxis], longest=longest)
    assert result.spikes == (0,)
    np.testing.assert_array_equal(result.samples[0], CLEAN[name])


@pytest.mark.parametrize("name", ["noise up to 40 Hz", "a tone", "potholes on a rough road", "nothing"])
def test_spikes_of_one_to_three_samples_are_found_and_the_load_put_back(name):
    clean = CLEAN[name]
    height = 3.0 * (np.ptp(clean) or 1.0)
    spiked = clean.copy()
    places = [(500, 1), (4321, 2), (9000, 3), (9100, 1), (15_000, 3)]
    for number, (start, length) in enumerate(places):
        spiked[start : start + length] += height * (-1) ** number
    result = remove_spikes(np.stack([clean, spiked]), longest=3)
    assert result.spikes == (0, 5)
    assert result.largest[1] == pytest.approx(height, rel=0.3)
    wrong = np.abs(result.samples[1] - clean)
    touched = np.zeros(clean.size, dtype=bool)
    for start, length in places:
        touched[start - 3 : start + length + 3] = True
    assert wrong[~touched].max() == 0.0
    assert wrong.max() <= 0.1 * np.ptp(clean)


def test_the_search_follows_the_level_and_the_sign_of_the_load():
    spiked = band_limited(40.0, seed=5)
    spiked[[700, 12_000]] += 30.0 * np.std(spiked)
    once, turned = remove_spikes(spiked[np.newaxis], longest=2), remove_spikes(-1e4 * spiked[np.newaxis], longest=2)
    assert once.spikes == turned.spikes == (2,)
    np.testing.assert_allclose(turned.samples, -1e4 * once.samples, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("longest", "threshold", "sentence"),
    [(0, 10.0, "must be 1 or more"), (1, 0.0, "greater than 0"), (3, 10.0, "136 are needed")],
)
def test_a_search_that_cannot_be_is_refused(longest, threshold, sentence):
    with pytest.raises(ValueError, match=sentence):
        remove_spikes(np.zeros((1, 100)), longest=longest, threshold=threshold)
