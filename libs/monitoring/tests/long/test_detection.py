"""The detector: its scores are standard normal however little was learnt, and steps and ramps are told apart."""

import numpy as np
import pytest
from scipy import stats

from duralab_monitoring import ChangeWatch, MonitoringSettings
from duralab_monitoring.detection import WEIGHTS, ChangeDetector, normal_score

MANY = 4000


def learnt(repeats, *, events=1, seed=0):
    random = np.random.default_rng(seed)
    detector = ChangeDetector(events, MANY)
    for _ in range(repeats):
        for event in range(events):
            detector.learn(event, 3.0 + 0.5 * random.standard_normal(MANY))
    return detector, random


@pytest.mark.parametrize("freedom", [1.0, 4.0, 30.0, 1000.0])
def test_a_normal_score_is_as_improbable_as_the_value_of_t(freedom):
    t = np.array([-8.0, -1.0, 0.0, 0.3, 6.0])
    expected = np.sign(t) * stats.norm.isf(stats.t.sf(np.abs(t), freedom))
    np.testing.assert_allclose(normal_score(t, np.full(t.shape, freedom)), expected, rtol=1e-9, atol=1e-12)


def test_a_normal_score_goes_on_where_the_tail_is_no_number():
    t, freedom = np.geomspace(10.0, 1e6, 400), np.full(400, 300.0)
    score = normal_score(t, freedom)
    assert np.isfinite(score).all()
    assert (np.diff(score) > 0.0).all()
    assert np.diff(score).max() < 2.0


@pytest.mark.parametrize("repeats", [2, 5, 40])
def test_scores_are_standard_normal_however_few_repeats_were_learnt(repeats):
    detector, random = learnt(repeats)
    first = detector.score(0, 3.0 + 0.5 * random.standard_normal(MANY))[0]
    assert stats.kstest(first, "norm").pvalue > 0.01
    assert abs(np.mean(np.abs(first) > stats.norm.isf(0.005)) - 0.01) < 0.006


def test_scores_of_one_measure_do_not_depend_on_one_another():
    """A baseline that is learnt once makes all scores after it wrong together; one that grows does not."""
    detector, random = learnt(5)
    scores = []
    for _ in range(40):
        measures = 3.0 + 0.5 * random.standard_normal(MANY)
        before = detector.averages[0].copy()
        detector.score(0, measures)
        scores.append(detector.averages[0].copy())
        detector.learn(0, measures)
        assert before.shape == scores[-1].shape
    together = np.array(scores).sum(axis=0) / np.sqrt(len(scores))
    assert stats.kstest(together, "norm").pvalue > 0.01


def test_every_average_has_a_standard_deviation_of_one_with_scores_of_several_events():
    detector, random = learnt(5, events=3)
    for repeat in range(60):
        measures = 3.0 + 0.5 * random.standard_normal(MANY)
        scores = detector.score(repeat % 3, measures)
        detector.learn(repeat % 3, measures)
    assert scores.shape == (WEIGHTS.size, MANY)
    np.testing.assert_allclose(scores.std(axis=1), 1.0, atol=0.05)
    np.testing.assert_allclose(scores.mean(axis=1), 0.0, atol=0.06)


def test_all_events_feed_the_same_averages():
    detector, random = learnt(200, events=2)
    for repeat in range(16):
        scores = detector.score(repeat % 2, 3.0 + 0.5 * (2.0 + random.standard_normal(MANY)))
    kept = 1.0 - WEIGHTS[3]
    expected = 2.0 * (1.0 - kept**16) / np.sqrt(WEIGHTS[3] / (1.0 + kept) * (1.0 - kept**32))
    assert scores[3].mean() == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(("baseline", "events"), [(6, 1), (10, 2), (60, 1)])
def test_the_false_alarm_rate_that_is_stated_holds(baseline, events):
    """On Gaussian measures, from the first repeat that is judged, with a baseline that is learnt from few repeats."""
    stated, channels, names = 300.0, ("a", "b", "c"), ("one", "two")[:events]
    settings = MonitoringSettings(false_alarms=stated, baseline_repeats=baseline)
    count, repeats, seeds = 0, 150, 20
    for seed in range(seeds):
        random = np.random.default_rng([7, seed])
        watch = ChangeWatch(settings, names, channels=channels)
        for name in names * (baseline // 2):
            watch.learn(name, random.standard_normal((3, 19)))
        beyond = 0
        for repeat in range(repeats):
            watch.judge(repeat, names[repeat % events], random.standard_normal((3, 19)))
            now = int(np.sum((watch.undecided > 0) | (watch.latched > 0)))
            count, beyond = count + max(0, now - beyond), now
            watch.latched[:] = 0
    expected = stated * 1e-4 * repeats * seeds
    assert 0.2 * expected < count < stats.poisson.isf(1e-3, expected)


def course(shape, *, noise=1.0, seed=3, before=100, after=400):
    """Return age and explanation of a change when it is first explained with certainty, for 50 measures each."""
    random, detector, found = np.random.default_rng(seed), ChangeDetector(1, 50), {}
    for repeat in range(before + after):
        age = repeat - before + 1
        measures = noise * random.standard_normal(50) + (shape(age) if age > 0 else 0.0)
        clear = np.zeros(50)
        if repeat >= 5:
            clear = np.abs(detector.score(0, measures)).max(axis=0)
        for measure in np.flatnonzero(clear > 5.9):
            explained = detector.explain(int(measure))
            if explained.evidence > 3.0:
                found.setdefault(int(measure), (age, explained))
        if len(found) == 50:
            break
        detector.learn(0, measures, clear < 4.0)
    return list(found.values())


@pytest.mark.parametrize("size", [4.0, 10.0, 1e3])
def test_a_step_is_a_step_and_begins_when_it_began(size):
    found = course(lambda _: size)
    assert len(found) == 50
    assert np.mean([explained.sudden for _, explained in found]) > 0.9
    assert np.median([abs(explained.age - age) for age, explained in found]) <= 1
    if size >= 10.0:
        assert {age for age, _ in found} <= {1, 2}


@pytest.mark.parametrize("slope", [0.03, 0.1, 0.3])
def test_a_ramp_is_a_drift_and_begins_when_it_began(slope):
    found = course(lambda age: slope * age)
    assert len(found) == 50
    assert np.mean([not explained.sudden for _, explained in found]) > 0.9
    assert np.median([abs(explained.age - age) / age for age, explained in found]) < 0.3


@pytest.mark.parametrize("slope", [0.3, 1.0, 10.0])
def test_a_drift_that_began_while_the_baseline_was_learnt_is_no_step(slope):
    random, detector, found = np.random.default_rng(4), ChangeDetector(2, 50), {}
    for repeat in range(200):
        measures = slope * repeat + random.standard_normal(50)
        # Ten repeats of each event are learnt before the first score.
        clear = np.abs(detector.score(repeat % 2, measures)).max(axis=0) if repeat >= 20 else np.zeros(50)
        for measure in np.flatnonzero(clear > 5.9):
            found.setdefault(int(measure), detector.explain(int(measure)))
        detector.learn(repeat % 2, measures, clear < 4.0)
    assert len(found) == 50
    assert np.mean([not explained.sudden for explained in found.values()]) > 0.9


def test_repeats_that_are_the_same_to_the_last_bit_have_no_score():
    detector = ChangeDetector(1, 2)
    for _ in range(4):
        detector.learn(0, [0.1, 0.2])
    np.testing.assert_array_equal(detector.score(0, [0.1, 0.2]), 0.0)
    assert np.abs(detector.score(0, [0.1, 0.2001])[0, 1]) > 5.0
