from dataclasses import replace

import numpy as np
import pytest
import rainflow

from duralab_settings import StopCriteria
from iterator import IterationMetrics, Outcome, best_iteration, damage_spent, judge_end, judge_response
from iterator.assessment import best_at_full_level


def after(*errors, damage=1.0):
    """Metrics of playbacks with these errors per channel; every channel does this damage at every slope."""
    return tuple(
        IterationMetrics(
            relative_rms_error=np.array(channels),
            rms_response=np.ones(len(channels)),
            peak_ratio=np.ones(len(channels)),
            overall_relative_rms_error=float(np.sqrt(np.mean(np.square(channels)))),
            crest_ratio=np.ones(len(channels)),
            damage_ratio=np.full((len(channels), 3), damage),
            specimen_damage=np.full((len(channels), 3), damage),
        )
        for channels in errors
    )


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ([(0.5, 0.5)], None),
        ([(0.5, 0.5), (0.1, 0.11)], None),
        ([(0.5, 0.5), (0.1, 0.1)], Outcome.REACHED),
        ([(0.5, 0.5), (0.4, 0.51)], None),
        ([(0.5, 0.2), (0.4, 0.31)], Outcome.DIVERGED),
        ([(0.5, 0.2), (0.2, 0.11), (0.15, 0.17)], Outcome.DIVERGED),
        ([(0.5, 0.5), (0.4, 0.4), (0.3, 0.3), (0.2, 0.2)], Outcome.ITERATIONS_USED),
        ([(0.5, 0.5), (0.4, 0.4), (0.3, 0.3), (0.1, 0.1)], Outcome.REACHED),
    ],
)
def test_the_iteration_ends_for_its_reason(errors, expected):
    criteria = StopCriteria(iterations=4, relative_rms_error=0.1, divergence_ratio=1.5)
    assert judge_end(after(*errors), criteria) is expected


def test_zero_switches_reaching_and_diverging_off():
    criteria = StopCriteria(iterations=3)
    assert judge_end(after((0.5,), (0.0,)), criteria) is None
    assert judge_end(after((0.5,), (50.0,)), criteria) is None


def test_the_asked_error_counts_only_with_the_damage_within_its_bounds():
    criteria = StopCriteria(iterations=5, relative_rms_error=0.1, damage_ratio=(0.8, 1.25))
    assert judge_end(after((0.1, 0.1)), criteria) is Outcome.REACHED
    assert judge_end(after((0.1, 0.1), damage=0.79), criteria) is None
    assert judge_end(after((0.1, 0.1), damage=1.26), criteria) is None
    assert judge_end(after((0.1, 0.2)), criteria) is None


def test_one_channel_beyond_the_damage_bounds_is_enough_and_only_the_asked_slope_counts():
    asked = StopCriteria(iterations=5, damage_ratio=(0.8, 1.25), damage_exponent=3)
    (figures,) = after((0.5, 0.5))
    figures.damage_ratio[1] = [1.2, 5.0, 50.0]
    assert judge_end((figures,), asked) is Outcome.REACHED
    assert judge_end((figures,), asked.model_copy(update={"damage_exponent": 8})) is None


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ([0.5, 0.4], None),
        ([0.5, 0.4, 0.39], None),
        ([0.5, 0.4, 0.395, 0.392], Outcome.NO_IMPROVEMENT),
        ([0.5, 0.4, 0.45, 0.37], None),
        ([0.5, 0.4, 0.45, 0.5], Outcome.NO_IMPROVEMENT),
    ],
)
def test_it_ends_when_the_last_playbacks_did_not_improve_the_best_by_the_asked_share(errors, expected):
    criteria = StopCriteria(iterations=10, smallest_improvement=0.05, improvement_playbacks=2)
    assert judge_end(after(*((error, error) for error in errors)), criteria) is expected


def test_the_damage_budget_leaves_room_for_the_next_playback():
    criteria = StopCriteria(iterations=10, damage_budget=3.0)
    assert judge_end(after((0.5,)), criteria) is None
    assert judge_end(after((0.5,), (0.4,)), criteria) is None
    assert judge_end(after((0.5,), (0.4,), (0.3,)), criteria) is Outcome.DAMAGE_BUDGET_USED
    # A small playback may be followed by one that does the whole target's damage; a large one by another such.
    assert judge_end(after((0.5,), damage=0.1), criteria) is None
    assert judge_end(after((0.5,), damage=1.6), criteria) is Outcome.DAMAGE_BUDGET_USED
    # Earlier playbacks count for the budget and for nothing else.
    assert judge_end(after((0.5,)), criteria, earlier=after((0.01,), (0.01,))) is Outcome.DAMAGE_BUDGET_USED


def test_the_damage_budget_counts_the_identification():
    criteria = StopCriteria(iterations=10, damage_budget=3.0)
    (one,) = after((0.5, 0.5))
    # One pass is played and one more is to come: 1.0 is left for the identification, in every channel.
    for identification, expected in ((1.0, None), (1.01, Outcome.DAMAGE_BUDGET_USED)):
        before = np.array([[0.0, identification, 0.0], [0.0, 0.0, 0.0]])
        assert judge_end((replace(one, identification_damage=before),), criteria) is expected
    # Of another slope it does not count; nor does that of a watched response without a target.
    before = np.array([[9.0, 0.0, 9.0], [np.nan, np.nan, np.nan]])
    watched = replace(one, identification_damage=before, controlled=np.array([True, False]))
    assert judge_end((watched,), criteria) is None
    np.testing.assert_allclose(damage_spent((watched, watched), exponent=3.0), [11.0, np.nan])


def test_the_specimen_bears_what_is_measured_outside_the_band_too():
    time = np.arange(4000) / 200.0
    target = np.sin(2.0 * np.pi * 5.0 * time)[np.newaxis]
    # Four times as large at a fifth of the frequency, as outside of a control band, and a static part.
    measured = 0.5 * target + 2.0 * np.sin(2.0 * np.pi * 1.0 * time) + 700.0
    judged = judge_response(target, target, level=0.5, measured=measured)
    np.testing.assert_allclose(judged.damage_ratio, 1.0)
    cycles = [sum(count * range_**k for range_, count in rainflow.count_cycles(measured[0])) for k in (3.0, 5.0, 8.0)]
    one = [sum(count * range_**k for range_, count in rainflow.count_cycles(target[0])) for k in (3.0, 5.0, 8.0)]
    np.testing.assert_allclose(judged.specimen_damage[0], np.divide(cycles, one), rtol=1e-9)
    # At rest it counts as the target at half its size.
    still = judge_response(target, 0.0 * target, level=0.5, measured=0.0 * measured)
    np.testing.assert_allclose(still.specimen_damage[0], 0.5 ** np.array([3.0, 5.0, 8.0]))


def test_damage_spent_adds_up_and_a_playback_at_half_level_spends_its_power():
    target = np.random.default_rng(0).standard_normal((2, 2000))
    half = judge_response(target, target, level=0.5)
    whole = judge_response(target, target)
    np.testing.assert_allclose(half.damage_ratio, 1.0)
    np.testing.assert_allclose(damage_spent((half, whole), exponent=5.0), 1.0 + 0.5**5.0)


def test_a_channel_that_tells_too_little_counts_as_the_target_at_its_level():
    target = np.random.default_rng(0).standard_normal((3, 2000))
    # Dead, at half its size, and a half too large.
    response = np.array([[0.0], [0.5], [1.5]]) * target
    whole, half = judge_response(target, response), judge_response(target, response, level=0.5)
    np.testing.assert_allclose(whole.damage_ratio[:, 1], [0.0, 0.5**5, 1.5**5])
    np.testing.assert_allclose(damage_spent((whole, half), exponent=5.0), (1.0 + 0.5**5) * np.array([1.0, 1.0, 1.5**5]))
    criteria = StopCriteria(iterations=10, damage_budget=3.0)
    dead = judge_response(target, 0.0 * target)
    assert judge_end((dead, dead), criteria) is None
    assert judge_end((dead, dead, dead), criteria) is Outcome.DAMAGE_BUDGET_USED


@pytest.mark.parametrize("wrong", [(1.1, 1.2), (-0.1, 2.0), (0.5, 1.0), (0.5, np.inf)])
def test_damage_bounds_that_do_not_hold_the_target_itself_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must be (below 1|greater than or equal to 0|a finite number)"):
        StopCriteria(iterations=3, damage_ratio=wrong)


def test_a_slope_that_is_not_judged_is_refused_with_those_that_are():
    with pytest.raises(ValueError, match="damage_exponent is 4; allowed: 3, 5, 8"):
        StopCriteria(iterations=3, damage_exponent=4)


def test_the_best_playback_is_the_one_with_the_smallest_overall_error():
    assert best_iteration(after((0.5, 0.5), (0.1, 0.3), (0.2, 0.4))) == 2
    assert best_iteration(()) == 0


def test_where_the_target_was_reached_the_last_playback_is_the_best_whatever_its_overall_error():
    metrics = after((0.5, 0.5), (0.01, 0.16), (0.14, 0.14))
    assert judge_end(metrics, StopCriteria(iterations=9, relative_rms_error=0.15)) is Outcome.REACHED
    assert best_at_full_level(metrics, ()) == 2
    assert best_at_full_level(metrics, (), outcome=Outcome.ITERATIONS_USED) == 2
    assert best_at_full_level(metrics, (), outcome=Outcome.REACHED) == 3
    assert best_at_full_level(metrics, (0.5, 0.75, 1.0)) == 3
    assert best_at_full_level(metrics[:1], (0.5, 1.0)) == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"iterations": 0},
        {"relative_rms_error": -0.1},
        {"divergence_ratio": 0.9},
        {"smallest_improvement": 1.0},
        {"improvement_playbacks": 0},
        {"damage_budget": np.inf},
    ],
)
def test_impossible_criteria_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        StopCriteria(**{"iterations": 3, **wrong})


def test_metrics_of_a_scaled_response_are_analytic():
    target = np.array([[3.0, -4.0, 0.0, 1.0], [0.1, 0.2, -0.2, 0.1]])
    figures = judge_response(target, np.array([[0.8], [1.5]]) * target)
    np.testing.assert_allclose(figures.relative_rms_error, [0.2, 0.5])
    np.testing.assert_allclose(figures.rms_response, [0.8, 1.5])
    np.testing.assert_allclose(figures.peak_ratio, [0.8, 1.5])
    np.testing.assert_allclose(figures.crest_ratio, 1.0)
    np.testing.assert_allclose(figures.damage_ratio[:, 1], [0.8**5, 1.5**5])
    assert figures.overall_relative_rms_error == pytest.approx(np.sqrt((0.2**2 + 0.5**2) / 2.0))


def test_a_response_at_rest_has_no_crest_and_does_no_damage():
    target = np.random.default_rng(1).standard_normal((1, 100))
    figures = judge_response(target, np.zeros((1, 100)))
    np.testing.assert_array_equal(figures.crest_ratio, 0.0)
    np.testing.assert_array_equal(figures.damage_ratio, 0.0)
    np.testing.assert_allclose(figures.relative_rms_error, 1.0)
