"""A monitor in the life of a specimen: what it raises, at which level, where, and what survives a crash."""

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from duralab_monitoring import AlarmKind, AlarmLevel, Measure, Monitor, MonitoringSettings, RepeatVerdict

RATE, SAMPLES = 500.0, 2500
CHANNELS = ("left", "right", "middle")
BANDS = ((0.5, 2.0), (2.0, 5.0), (5.0, 10.0), (10.0, 20.0), (20.0, 40.0), (40.0, 80.0))


def road(seed, low=1.0, high=30.0):
    filtered = butter(2, [low, high], "band", fs=RATE, output="sos")
    return 1000.0 * sosfilt(filtered, np.random.default_rng(seed).standard_normal((len(CHANNELS), SAMPLES)), axis=1)


def monitor(events=("road",), **settings):
    return Monitor(MonitoringSettings(**settings), events, channels=CHANNELS, sample_rate=RATE)


def judged(watch, response, repeats, *, noise=5.0, seed=1, first=0, events=("road",)):
    """Play repeats of a response that is a function of the repeat; return all alarms."""
    found = []
    for repeat in range(first, first + repeats):
        record = response(repeat)
        record = record + noise * np.random.default_rng([seed, repeat]).standard_normal(record.shape)
        found += watch.judge(repeat, events[repeat % len(events)], response=record).alarms
    return found


def test_a_specimen_that_does_not_change_raises_nothing():
    played = road(3)
    assert judged(monitor(), lambda _: played, 120) == []


def test_a_step_of_the_gain_is_found_at_once_as_a_sudden_change_in_its_channel():
    played = road(3)
    gain = np.array([[1.0], [0.95], [1.0]])
    (alarm,) = judged(monitor(), lambda repeat: played * gain ** (repeat >= 40), 60)
    assert (alarm.kind, alarm.channel, alarm.measure) == (AlarmKind.SUDDEN_CHANGE, "right", Measure.GAIN)
    assert alarm.repeat == alarm.since == 40
    assert alarm.band in BANDS
    assert "right" in alarm.sentence


def test_a_monitor_that_is_restored_goes_on_with_the_same_bytes():
    played = road(3)
    life = lambda repeat: played * (1.0 + 0.001 * max(0, repeat - 20))  # noqa: E731
    whole, parts = monitor(), monitor()
    expected = judged(whole, life, 50)
    found, baseline = [], b""
    for repeat in range(50):
        found += judged(parts, life, 1, first=repeat)
        baseline = parts.baseline("road")
        parts = Monitor.restored(
            MonitoringSettings(),
            ["road"],
            channels=CHANNELS,
            sample_rate=RATE,
            state=parts.state(),
            baselines={"road": baseline},
        )
    assert found == expected != []
    assert parts.state() == whole.state()


def test_a_monitor_that_replays_what_was_stored_has_the_same_state_at_every_repeat():
    played = road(3)
    events = ("road", "kerb")
    whole, replayed = monitor(events), monitor(events)
    for repeat in range(60):
        record = played * (1.0 + 0.2 * (repeat >= 40)) + 5.0 * np.random.default_rng(repeat).standard_normal(
            played.shape
        )
        event = events[repeat % 2]
        verdict = whole.judge(repeat, event, response=record)
        baseline = whole.baseline(event) if verdict.baseline_changed else b""
        again = replayed.replay(repeat, event, verdict.statistics, baseline=baseline)
        assert again.alarms == verdict.alarms
        assert replayed.state() == whole.state()
        assert replayed.baseline(event) == whole.baseline(event)
    assert again.statistics is verdict.statistics
    with pytest.raises(ValueError, match="mean of 0 repeats and the state needs that of 1"):
        monitor().replay(0, "road", verdict.statistics)


def test_a_slow_loss_is_a_drift_of_its_channel():
    played = road(3)
    slope = np.array([[0.0], [0.0], [-2e-4]])
    (alarm,) = judged(monitor(), lambda repeat: played * (1.0 + slope * max(0, repeat - 39)), 100)
    assert (alarm.kind, alarm.channel) == (AlarmKind.SLOW_DRIFT, "middle")
    assert alarm.size < 0.0
    assert abs(alarm.since - 40) < 8
    assert alarm.repeat > 45


def test_a_rattle_is_found_in_its_band_as_a_remainder():
    played = road(3, high=15.0)
    rattle = road(9, low=45.0, high=70.0)[0]

    def response(repeat):
        shaken = np.roll(rattle, 37 * repeat) * (repeat >= 40) * 0.02
        return played + shaken * np.array([[0.0], [0.0], [1.0]])

    (alarm,) = judged(monitor(), response, 60)
    assert (alarm.channel, alarm.band, alarm.measure) == ("middle", (40.0, 80.0), Measure.REMAINDER)
    assert alarm.kind is AlarmKind.SUDDEN_CHANGE


def test_an_offset_is_found_in_the_static_part():
    played = road(3)
    offset = np.array([[2.0], [0.0], [0.0]])
    (alarm,) = judged(monitor(), lambda repeat: played + offset * (repeat >= 40), 60)
    assert (alarm.channel, alarm.band, alarm.measure) == ("left", None, Measure.STATIC)
    assert "static part" in alarm.sentence


def test_a_large_change_is_an_abort_and_a_warning_that_grows_is_raised_again():
    played = road(3)
    change = {40: -0.02, 50: -0.6}
    gain = [sum(size for start, size in change.items() if repeat >= start) for repeat in range(60)]
    found = judged(monitor(), lambda repeat: played * (1.0 + np.array([[0.0], [1.0], [0.0]]) * gain[repeat]), 60)
    changes = [(alarm.repeat, alarm.level) for alarm in found if alarm.kind is not AlarmKind.LIMIT]
    assert changes == [(40, AlarmLevel.WARNING), (50, AlarmLevel.ABORT)]


def test_changes_below_the_warning_level_are_not_raised():
    played = road(3)
    settings = {"change": {"warning": 0.05, "abort": 0.3}}
    assert judged(monitor(**settings), lambda repeat: played * (1.0 + 0.02 * (repeat >= 40)), 60) == []
    found = judged(monitor(**settings), lambda repeat: played * (1.0 + 0.09 * (repeat >= 40)), 60)
    assert {alarm.channel for alarm in found} == set(CHANNELS)


def test_every_event_is_judged_against_its_own_baseline():
    roads, events = (road(3), 0.5 * road(4)), ("smooth", "rough")
    gain = np.array([[1.0], [1.004], [1.0]])
    assert judged(monitor(events), lambda repeat: roads[repeat % 2], 120, events=events) == []
    (alarm,) = judged(monitor(events), lambda repeat: roads[repeat % 2] * gain ** (repeat >= 60), 100, events=events)
    assert (alarm.channel, alarm.event) == ("right", events[alarm.repeat % 2])


def test_an_event_that_comes_later_is_learnt_without_an_alarm():
    watch, events = monitor(("first", "later")), ("later",)
    assert judged(watch, lambda _: road(3), 40, events=("first",)) == []
    assert judged(watch, lambda _: 3.0 * road(5), 60, first=40, events=events) == []


def test_a_record_that_begins_late_is_no_change():
    played = road(3)
    turn = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)

    def response(repeat):
        delay = np.random.default_rng([8, repeat]).uniform(-2e-3, 2e-3)
        return np.fft.irfft(np.fft.rfft(played) * np.exp(-2j * np.pi * turn * delay), n=SAMPLES)

    assert judged(monitor(), response, 80) == []


def test_a_rig_without_noise_is_judged_to_the_last_bit():
    played = road(3)
    found = judged(monitor(), lambda repeat: played * (1.0 + 1e-6 * (repeat >= 30)), 31, noise=0.0)
    assert {alarm.channel for alarm in found} == set(CHANNELS)
    assert {alarm.repeat for alarm in found} == {30}


def test_a_change_that_was_accepted_is_learnt_again():
    played, watch = road(3), monitor()
    assert judged(watch, lambda repeat: played * 1.05 ** (repeat >= 40), 50) != []
    watch.relearn()
    assert watch.baseline("road") == b""
    assert judged(watch, lambda _: 1.05 * played, 60, first=50) == []
    assert judged(watch, lambda _: played, 1, first=110) != []


def test_a_verdict_says_when_the_baseline_is_stored_and_when_it_judges():
    watch, played = monitor(baseline_repeats=6), road(3)
    verdicts: list[RepeatVerdict] = [watch.judge(repeat, "road", response=played) for repeat in range(8)]
    assert [verdict.baseline_changed for verdict in verdicts] == [True] * 3 + [False] * 5
    assert [verdict.judged for verdict in verdicts] == [False] * 6 + [True] * 2
    assert np.isnan(verdicts[2].statistics.residual).all()
    assert np.isfinite(verdicts[3].statistics.residual).all()
    assert verdicts[7].level is None


@pytest.mark.parametrize("names", [[], ["road", "road"]])
def test_events_need_names_of_their_own(names):
    with pytest.raises(ValueError, match="each name once"):
        monitor(names)


def test_a_band_above_half_the_sample_rate_and_a_limit_of_no_channel_are_refused():
    with pytest.raises(ValueError, match=r"ends at 300 Hz; at 500 Hz it may end at 250 Hz"):
        monitor(bands=(1.0, 300.0))
    with pytest.raises(ValueError, match="names the channel 'top'; the rig has left, right, middle"):
        monitor(limits={"top": {"rms": {"abort": [0, 1]}}})


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"event": "gravel"}, "event 'gravel' is not in the schedule"),
        ({"response": road(3)[:2]}, "has 2 channels; the rig has 3"),
        ({"response": road(3)[:, :-1]}, "2499 samples and 0 commands, its baseline 2500 and 0"),
        ({"command": road(3)}, "2500 samples and 3 commands, its baseline 2500 and 0"),
        ({"command": road(3)[:, 1:]}, "command has 2499 samples and the response 2500"),
        ({"response": road(3) * np.nan}, "must be finite"),
    ],
)
def test_a_repeat_that_does_not_fit_is_refused_and_changes_nothing(given, reason):
    watch = monitor()
    judged(watch, lambda _: road(3), 12)
    before = watch.state()
    with pytest.raises(ValueError, match=reason):
        watch.judge(12, **{"event": "road", "response": road(3), **given})
    assert watch.state() == before


def test_a_state_is_restored_only_into_the_same_test_with_its_baseline():
    watch = monitor()
    judged(watch, lambda _: road(3), 4)
    state, baseline = watch.state(), watch.baseline("road")
    judged(watch, lambda _: road(3), 8, first=4)

    def restored(state, baseline, **settings):
        return Monitor.restored(
            MonitoringSettings(**settings),
            ["road"],
            channels=CHANNELS,
            sample_rate=RATE,
            state=state,
            baselines={"road": baseline} if baseline else {},
        )

    assert restored(state, baseline).state() == state
    for wrong, reason in (
        ((watch.state(), baseline), "is the mean of 4 repeats and the state needs that of 5"),
        ((state, b""), "is the mean of 0 repeats and the state needs that of 4"),
        ((state[:-200], baseline), "no state and no baseline"),
        ((state, b"what"), "no state and no baseline"),
    ):
        with pytest.raises(ValueError, match=reason):
            restored(*wrong)
    with pytest.raises(ValueError, match="other settings, events or channels"):
        restored(state, baseline, false_alarms=2.0)


def test_alarms_stand_until_the_baseline_is_learnt_again_also_after_a_crash():
    events = ("road", "rough")
    watch = monitor(events, change={"warning": 0.0, "abort": 10.0})
    played = {0: road(3), 1: road(4)}
    louder = np.array([[1.0], [1.3], [1.0]])
    found = judged(watch, lambda repeat: played[repeat % 2] * louder ** (repeat >= 40), 60, events=events)
    changes = {alarm for alarm in found if alarm.kind is not AlarmKind.LIMIT}
    limits = {event: {alarm for alarm in found if alarm.event == event} - changes for event in events}
    assert changes
    assert all(limits.values())
    parts = {"channels": CHANNELS, "sample_rate": RATE}
    settings = MonitoringSettings(change={"warning": 0.0, "abort": 10.0})
    baselines = {event: watch.baseline(event) for event in events}
    restored = Monitor.restored(settings, events, state=watch.state(), baselines=baselines, **parts)
    for each in (watch, restored):
        for event in events:
            assert set(each.standing(event)) == limits[event] | changes
            assert len(each.standing(event)) == len(limits[event] | changes)
        each.relearn("road")
        assert each.standing("road") == ()
        assert set(each.standing("rough")) == limits["rough"]
        each.relearn()
        assert each.standing("rough") == ()
    with pytest.raises(ValueError, match="The event 'gravel' is not in the schedule"):
        watch.standing("gravel")
