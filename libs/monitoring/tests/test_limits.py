"""Limits of the statistics: absolute ones from the first repeat on, learnt ones beyond what noise explains."""

import numpy as np
import pytest

from duralab_monitoring import AbsoluteLimits, AlarmKind, AlarmLevel, Monitor, MonitoringSettings, Statistic

RATE, SAMPLES = 500.0, 2500
TIME = np.arange(SAMPLES) / RATE
WAVE = 100.0 * np.sin(2 * np.pi * 3.0 * TIME) + 40.0 * np.sin(2 * np.pi * 11.0 * TIME)


def monitor(**settings):
    return Monitor(MonitoringSettings(**settings), ["road"], channels=["force"], sample_rate=RATE)


def judged(watch, record, *, repeat=0, noise=0.1):
    random = np.random.default_rng([4, repeat])
    return watch.judge(repeat, "road", response=record[np.newaxis] + noise * random.standard_normal((1, SAMPLES)))


def limits_of(verdict):
    return {alarm.measure: alarm for alarm in verdict.alarms if alarm.kind is AlarmKind.LIMIT}


def test_the_table_has_the_statistics_of_the_record():
    verdict = judged(monitor(damage_exponent=3), WAVE + 7.0, noise=0.0)
    told = {statistic: verdict.statistics.column(statistic)[0] for statistic in Statistic}
    assert told[Statistic.MEAN] == pytest.approx(7.0)
    assert told[Statistic.STD] == pytest.approx(np.sqrt(0.5 * (100.0**2 + 40.0**2)))
    assert told[Statistic.RMS] == pytest.approx(np.hypot(told[Statistic.STD], 7.0))
    assert (told[Statistic.MIN], told[Statistic.MAX]) == ((WAVE + 7.0).min(), (WAVE + 7.0).max())
    twice = judged(monitor(damage_exponent=3), 2.0 * WAVE, noise=0.0).statistics.column(Statistic.DAMAGE)[0]
    assert twice == pytest.approx(8.0 * told[Statistic.DAMAGE])


def test_absolute_limits_hold_from_the_first_repeat_and_are_raised_once_for_a_level():
    given = AbsoluteLimits(warning=(-150.0, 150.0), abort=(-200.0, 200.0))
    watch = monitor(limits={"force": {Statistic.MAX: given}})
    assert limits_of(judged(watch, WAVE, repeat=0)) == {}
    (alarm,) = limits_of(judged(watch, 1.3 * WAVE, repeat=1)).values()
    assert (alarm.level, alarm.channel, alarm.repeat) == (AlarmLevel.WARNING, "force", 1)
    assert alarm.size == pytest.approx(1.3 * WAVE.max(), rel=0.01)
    assert "outside its warning limits of -150 to 150" in alarm.sentence
    assert limits_of(judged(watch, 1.3 * WAVE, repeat=2)) == {}
    (alarm,) = limits_of(judged(watch, 2.0 * WAVE, repeat=3)).values()
    assert alarm.level is AlarmLevel.ABORT


def test_a_statistic_away_from_its_baseline_passes_the_learnt_limits():
    watch = monitor()
    for repeat in range(12):
        assert judged(watch, WAVE, repeat=repeat).alarms == ()
    assert limits_of(judged(watch, 1.08 * WAVE, repeat=12)) == {}
    raised = limits_of(judged(watch, 1.15 * WAVE, repeat=13))
    assert set(raised) == {Statistic.MIN, Statistic.MAX, Statistic.RMS, Statistic.STD, Statistic.DAMAGE}
    assert {alarm.level for alarm in raised.values()} == {AlarmLevel.WARNING}
    assert all(
        alarm.size == pytest.approx(-0.15 if alarm.measure is Statistic.MIN else 0.15, rel=0.02)
        for alarm in raised.values()
    )
    raised = limits_of(judged(watch, 1.5 * WAVE, repeat=14))
    assert {alarm.level for alarm in raised.values()} == {AlarmLevel.ABORT}


def test_a_mean_counts_against_the_rms():
    watch = monitor()
    for repeat in range(12):
        judged(watch, WAVE, repeat=repeat)
    raised = limits_of(judged(watch, WAVE + 20.0, repeat=12))
    assert raised[Statistic.MEAN].size == pytest.approx(20.0 / WAVE.std(), rel=0.01)


def test_statistics_that_scatter_by_more_than_a_level_raise_nothing():
    """Repeats of noise differ by more than the warning level; the t distribution says how much they may."""
    alarms = []
    for seed in range(6):
        watch, random = monitor(baseline_repeats=6), np.random.default_rng(seed)
        for repeat in range(60):
            record = random.standard_normal((1, SAMPLES)) * random.uniform(0.6, 1.6)
            alarms += limits_of(watch.judge(repeat, "road", response=record)).values()
    assert alarms == []


def test_a_channel_that_never_moved_passes_its_limits_when_it_moves():
    watch = monitor()
    for repeat in range(12):
        judged(watch, 0.0 * WAVE, repeat=repeat, noise=0.0)
    assert limits_of(judged(watch, WAVE, repeat=12, noise=0.0))[Statistic.MAX].level is AlarmLevel.ABORT


def test_a_new_drive_passes_an_abort_limit_if_it_is_farther_outside_than_the_present_one():
    given = AbsoluteLimits(warning=(60.0, 150.0), abort=(50.0, 200.0))
    watch = monitor(limits={"force": {Statistic.MAX: given}})
    passed = lambda new, present: watch.passed_abort_limit([new * WAVE], present=[present * WAVE])  # noqa: E731
    before = watch.state()
    peak = WAVE.max()
    assert passed(1.4, 1.0) == ""  # beyond the warning only
    assert passed(2.0, 1.0) == f"force: max of {2.0 * peak:.4g} is outside its abort limits of 50 to 200"
    assert passed(2.0, 1.9) != ""
    assert passed(2.0, 2.1) == ""
    # From below: a worn specimen may be under its limit, and a correction brings it back step by step.
    assert passed(0.3, 0.2) == ""
    assert "outside its abort limits" in passed(0.2, 0.3)
    assert watch.state() == before
    with pytest.raises(ValueError, match="The response has 2 channels; the rig has 1"):
        watch.passed_abort_limit([WAVE, WAVE], present=[WAVE])
