import numpy as np
import pytest

from iterator import IterationMetrics, Outcome, StopCriteria, best_iteration, judge_end, judge_response


def after(*errors):
    return tuple(
        IterationMetrics(
            relative_rms_error=np.array(channels),
            rms_response=np.ones(len(channels)),
            peak_ratio=np.ones(len(channels)),
            overall_relative_rms_error=float(np.sqrt(np.mean(np.square(channels)))),
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
    criteria = StopCriteria(largest_iterations=4, relative_rms_error=0.1, divergence_ratio=1.5)
    assert judge_end(after(*errors), criteria) is expected


def test_zero_switches_reaching_and_diverging_off():
    criteria = StopCriteria(largest_iterations=3)
    assert judge_end(after((0.5,), (0.0,)), criteria) is None
    assert judge_end(after((0.5,), (50.0,)), criteria) is None


def test_the_best_playback_is_the_one_with_the_smallest_overall_error():
    assert best_iteration(after((0.5, 0.5), (0.1, 0.3), (0.2, 0.4))) == 2
    assert best_iteration(()) == 0


@pytest.mark.parametrize("wrong", [{"largest_iterations": 0}, {"relative_rms_error": -0.1}, {"divergence_ratio": 0.9}])
def test_impossible_criteria_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        StopCriteria(**{"largest_iterations": 3, **wrong})


def test_metrics_of_a_scaled_response_are_analytic():
    target = np.array([[3.0, -4.0, 0.0, 1.0], [0.1, 0.2, -0.2, 0.1]])
    figures = judge_response(target, np.array([[0.8], [1.5]]) * target)
    np.testing.assert_allclose(figures.relative_rms_error, [0.2, 0.5])
    np.testing.assert_allclose(figures.rms_response, [0.8, 1.5])
    np.testing.assert_allclose(figures.peak_ratio, [0.8, 1.5])
    assert figures.overall_relative_rms_error == pytest.approx(np.sqrt((0.2**2 + 0.5**2) / 2.0))
