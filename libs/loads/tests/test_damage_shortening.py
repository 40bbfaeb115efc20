import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from duralab_loads import count_load_cycles, damage_over_time, pseudo_damage, shorten_by_damage
from duralab_loads.damage_shortening import _windows_to_keep

RATE = 100


def bursts(*places, samples=20_000, seed=1):
    """Small noise everywhere, and ten seconds of ten times that at the places, in seconds."""
    noise = np.random.default_rng(seed).standard_normal(samples)
    level = np.ones(samples)
    for place in places:
        level[place * RATE : (place + 10) * RATE] = 10.0
    return noise * level


def damage(values, exponent):
    return pseudo_damage(count_load_cycles(values), exponent)


def test_damage_over_time_adds_up_and_lies_where_the_load_is_high():
    load = bursts(50)
    share = damage_over_time(load, exponent=5.0)
    assert share.sum() == pytest.approx(1.0)
    assert share[50 * RATE : 60 * RATE].sum() > 0.99
    np.testing.assert_allclose(damage_over_time(-3e4 * load + 7.0, exponent=5.0), share, atol=1e-12)
    np.testing.assert_array_equal(damage_over_time(np.ones(5), exponent=3.0), 0.0)
    # Half a cycle from the valley to the peak: a half at either.
    np.testing.assert_array_equal(damage_over_time([0.0, -1.0, 0.0, 1.0], exponent=1.0)[[1, 3]], [0.5, 1 / 3])


def test_the_bursts_of_either_channel_are_kept_and_the_calm_between_them_goes():
    record = np.stack([bursts(20), bursts(150, seed=2)])
    short = shorten_by_damage(record, keep=0.9, exponent=5.0, window_samples=RATE, fade_samples=20)
    assert np.all(short.kept >= 0.9)
    assert short.samples.shape[1] < 0.15 * record.shape[1]
    for start, end in short.sections:
        assert (start >= 19 * RATE and end <= 31 * RATE) or (start >= 149 * RATE and end <= 161 * RATE)
    for row in range(2):
        assert short.kept[row] == pytest.approx(damage(short.samples[row], 5.0) / damage(record[row], 5.0))


def test_the_order_of_the_channels_and_their_units_make_no_difference():
    record = np.stack([bursts(20), bursts(150, seed=2), bursts(60, 90, seed=3)])
    settings = {"keep": 0.95, "exponent": 5.0, "window_samples": RATE, "fade_samples": 20}
    straight = shorten_by_damage(record, **settings)
    turned = shorten_by_damage(record[::-1], **settings)
    scaled = shorten_by_damage(record * np.array([[-1024.0], [0.5], [4.0]]), **settings)
    assert straight.sections == turned.sections == scaled.sections
    np.testing.assert_array_equal(turned.samples[::-1], straight.samples)
    np.testing.assert_allclose(scaled.kept, straight.kept, rtol=1e-9)


def test_a_tie_between_windows_ends_alike_in_any_order_of_the_channels():
    # The first and the last window add 0.6 each; summed one after the other they differ by a rounding error.
    shares = np.array([[0.1, 0.25, 0.3], [0.2, 0.15, 0.2], [0.3, 0.19, 0.1]])
    assert _windows_to_keep(shares, keep=0.34) == _windows_to_keep(shares[::-1], keep=0.34) == [0, 1]


@settings(max_examples=25)
@given(
    keep=st.sampled_from([0.5, 0.9, 0.99, 1.0]),
    exponent=st.sampled_from([3.0, 5.0, 8.0]),
    window=st.integers(5, 200),
    fade=st.integers(0, 50),
    seed=st.integers(0, 100),
)
def test_every_channel_keeps_its_share_whatever_is_asked(keep, exponent, window, fade, seed):
    record = np.cumsum(np.random.default_rng(seed).standard_normal((2, 2000)), axis=1)
    short = shorten_by_damage(record, keep=keep, exponent=exponent, window_samples=window, fade_samples=fade)
    assert np.all(short.kept >= keep * (1 - 1e-9))
    joints = len(short.sections) - 1
    assert short.samples.shape[1] == sum(end - start for start, end in short.sections) - joints * fade
    assert short.samples.shape[1] <= record.shape[1]
    assert np.abs(short.samples).max() <= np.abs(record).max() * (1 + 1e-12)


def test_a_channel_at_rest_counts_for_nothing():
    record = np.stack([bursts(20), np.zeros(20_000)])
    short = shorten_by_damage(record, keep=0.9, exponent=5.0, window_samples=RATE, fade_samples=20)
    assert np.isnan(short.kept[1])
    alone = shorten_by_damage(record[:1], keep=0.9, exponent=5.0, window_samples=RATE, fade_samples=20)
    assert short.sections == alone.sections


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"keep": 0.0}, "damage to keep is 0"),
        ({"keep": 1.1}, "above 0 to 1"),
        ({"exponent": -1.0}, "exponent of the S-N line is -1"),
        ({"window_samples": 0}, "window is 0 samples"),
    ],
)
def test_what_cannot_be_shortened_is_refused(changed, sentence):
    settings = {"keep": 0.9, "exponent": 5.0, "window_samples": 10, "fade_samples": 2} | changed
    with pytest.raises(ValueError, match=sentence):
        shorten_by_damage(np.eye(3), **settings)
    with pytest.raises(ValueError, match="No channel moves"):
        shorten_by_damage(np.ones((2, 50)), keep=0.9, exponent=5.0, window_samples=10, fade_samples=2)
