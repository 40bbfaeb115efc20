import numpy as np
import pytest

from duralab.data import Channel, Signals, StepRecord
from duralab.errors import InputError
from duralab.report.provenance import target_step_rows
from duralab.target import edit_signals
from duralab_proto.v1 import iterator_pb2

RATE = 500.0
NAMES = ("left_vertical", "left_lateral", "right_vertical")


def road(*, seconds=60.0, seed=1, names=NAMES):
    """Noise at rest level 1, and from 20 to 30 s, on the left at 40 to 45 s too, ten times that."""
    samples = round(seconds * RATE)
    time = np.arange(samples) / RATE
    level = np.where((time >= 20) & (time < 30), 10.0, 1.0)
    noise = np.random.default_rng(seed).standard_normal((3, samples)) * level
    noise[:2] *= np.where((time >= 40) & (time < 45), 10.0, 1.0)
    rows = [noise[NAMES.index(name)] for name in names]
    return Signals(tuple(Channel(name, "N") for name in names), RATE, np.stack(rows))


def test_steps_are_applied_in_order_and_each_is_recorded():
    given = road()
    edited = edit_signals(given, [{"cut": {"from": 10, "to": 50}}, "remove_mean", {"resample": {"rate": 1000}}])
    assert edited.signals.samples.shape == (3, 40_000)
    assert edited.signals.sample_rate == 1000.0
    cut, mean, rate = edited.records
    assert (cut.seconds_before, cut.seconds_after, cut.sections) == (60.0, 40.0, ((10.0, 50.0),))
    assert (mean.samples_before, mean.samples_after) == (20_000, 20_000)
    assert (rate.samples_before, rate.samples_after, rate.seconds_after) == (20_000, 40_000, 40.0)
    assert "500 Hz became 1000 Hz" in rate.finding
    for row, channel in enumerate(cut.channels):
        kept, whole = given.samples[row, 5000:25_000], given.samples[row]
        assert channel.energy_removed == pytest.approx(1 - (kept @ kept) / (whole @ whole))
        assert channel.spikes is channel.damage_kept is None
    # White noise loses what lies between 0.87 and 1 of half its rate, and no more.
    assert all(0.0 < channel.energy_removed < 0.13 for channel in rate.channels)
    np.testing.assert_array_equal(given.samples, road().samples)


def test_the_energy_of_a_mean_is_what_it_is():
    given = road()
    offset = Signals(given.channels, RATE, given.samples - given.samples.mean(axis=1, keepdims=True) + 7.0)
    record = edit_signals(offset, ["remove_mean"]).records[0]
    for row, channel in enumerate(record.channels):
        variance = np.var(given.samples[row])
        assert channel.energy_removed == pytest.approx(49.0 / (49.0 + variance))


@pytest.mark.parametrize("scale", [2.0**-600, 2.0**600])
def test_the_energy_of_samples_whose_square_overflows_is_the_same(recwarn, scale):
    given = road()
    shares = [
        [channel.energy_removed for channel in edit_signals(signals, ["remove_mean"]).records[0].channels]
        for signals in (given, Signals(given.channels, RATE, given.samples * scale))
    ]
    assert shares[0] == shares[1]
    assert list(recwarn) == []


def test_a_step_may_be_of_some_channels_only():
    given = road()
    edited = edit_signals(given, [{"filter": {"low_pass": 20, "channels": ["left_lateral"]}}])
    np.testing.assert_array_equal(edited.signals.samples[[0, 2]], given.samples[[0, 2]])
    removed = [channel.energy_removed for channel in edited.records[0].channels]
    assert removed[0] == removed[2] == 0.0
    # White noise up to 250 Hz, of which a little less than 20 Hz is left.
    assert removed[1] == pytest.approx(1 - 20 / 250, abs=0.02)


def test_spikes_are_counted_by_channel():
    given = road()
    given.samples[1, [700, 21_000]] += 400.0
    record = edit_signals(given, [{"despike": {"longest": 0.002}}]).records[0]
    assert [channel.spikes for channel in record.channels] == [0, 2, 0]
    assert "spikes replaced: left_lateral 2;" in record.finding
    assert "no spike found" in edit_signals(road(), ["despike"]).records[0].finding


def test_shortening_keeps_the_damage_of_every_channel_and_says_how_much():
    step = {"shorten_by_damage": {"keep": 0.9, "exponent": 5, "window": 1.0, "cross_fade": 0.2}}
    edited = edit_signals(road(), [step])
    record = edited.records[0]
    kept = [channel.damage_kept for channel in record.channels]
    assert all(share >= 0.9 for share in kept)
    assert record.seconds_after < 18.0
    for start, end in record.sections:
        assert (start >= 19 and end <= 31) or (start >= 39 and end <= 46)
    assert "damage kept: left_vertical 9" in record.finding
    # Whatever the order of the channels.
    other = edit_signals(road(names=NAMES[::-1]), [step])
    np.testing.assert_array_equal(other.signals.samples[::-1], edited.signals.samples)
    assert {c.channel: c for c in other.records[0].channels} == {c.channel: c for c in record.channels}


def test_joined_segments_repeat_and_fade_into_each_other():
    given = road()
    join = {"segments": [{"from": 50}, {"from": 20, "to": 22, "repeat": 2}], "cross_fade": 0.5}
    edited = edit_signals(given, [{"join": join}])
    assert edited.signals.duration == pytest.approx(10 + 2 + 2 - 2 * 0.5)
    assert edited.records[0].sections == ((50.0, 60.0), (20.0, 22.0), (20.0, 22.0))
    np.testing.assert_array_equal(edited.signals.samples[:, :4750], given.samples[:, 25_000:29_750])


def test_a_taper_goes_to_the_mean_or_to_zero():
    given = road()
    loaded = Signals(given.channels, RATE, given.samples + 4000.0)
    mean = edit_signals(loaded, [{"taper": {"seconds": 1.0}}]).signals.samples
    zero = edit_signals(loaded, [{"taper": {"seconds": 1.0, "to": "zero"}}]).signals.samples
    assert np.abs(mean[:, 0] - 4000.0).max() < 1.0
    assert np.abs(zero[:, [0, -1]]).max() < 0.1


def test_a_record_says_in_words_what_was_done_and_survives_the_contract():
    steps = [{"shorten_by_damage": {"keep": 0.9}}, "despike", {"remove_drift": {"order": 2}}]
    for record in edit_signals(road(), steps).records:
        assert StepRecord.from_message(record.to_message()) == record
        assert "\n" not in str(record)
        assert record.finding
    assert "{keep: 0.9, exponent: 5.0, window: 1.0, cross_fade: 0.2}" in str(edit_signals(road(), steps).records[0])


def test_the_report_shows_every_step_with_what_it_did():
    records = edit_signals(road(), [{"cut": {"from": 10, "to": 50}}, "despike"]).records
    steps = [record.to_message() for record in records]
    first, second = target_step_rows(iterator_pb2.CampaignSpec(target_steps=steps))
    assert (first.name, first.before, first.after) == ("cut", "60 s, 500 Hz", "40 s, 500 Hz")
    assert "from: 10.0, to: 50.0" in first.settings
    assert first.finding.startswith("60 s became 40 s; energy removed")
    assert "no spike found" in second.finding


@pytest.mark.parametrize(
    ("step", "parts"),
    [
        ({"cut": {"from": 10, "to": 61}}, ["target.edit.1.cut: The stretch goes from 10 to 61 s", "lasts 60 s"]),
        ({"taper": {"seconds": 31}}, ["target.edit.1.taper", "Two fades of 15500 samples do not fit into 30000"]),
        ({"filter": {"low_pass": 250}}, ["target.edit.1.filter", "below 250 Hz, half the sample rate"]),
        ({"remove_mean": {"channels": ["middle"]}}, ["no channel middle", "left_vertical, left_lateral"]),
        ({"resample": {"rate": 1000.3}}, ["target.edit.1.resample", "no ratio of whole numbers"]),
        ({"join": {"segments": [{"to": 1}, {"to": 0.3}, {"to": 1}]}}, ["target.edit.1.join", "its fades need 200"]),
        ({"shorten": {}}, ["unknown key 'shorten' in target.edit.1"]),
        (3, ["target.edit.1 is 3"]),
    ],
)
def test_a_step_that_does_not_fit_is_named_with_its_place(step, parts):
    with pytest.raises(InputError) as caught:
        edit_signals(road(), ["remove_mean", step])
    for part in parts:
        assert part in caught.value.message
    assert caught.value.field.startswith("target.edit.1")


def test_samples_that_are_not_finite_are_refused():
    given = road()
    given.samples[0, 5] = np.nan
    with pytest.raises(InputError, match=r"target\.edit\.0\.remove_mean: .* not all finite"):
        edit_signals(given, ["remove_mean"])
