"""Which lines of the steps' spectra are formed, and what they hold."""

import numpy as np
import pytest

from duralab_spectra import CrossSpectra, cross_spectra, smooth_lines
from iterator import IterationHistory, Playback
from iterator.model import StepBlocks, averaged_steps, seen_steps

CHOSEN = {"block_samples": 64, "overlap": 0.5, "sample_rate": 100.0}


@pytest.mark.parametrize(
    ("first", "last", "expected"),
    [(10, 12, (8, 15)), (0, 0, (0, 5)), (1, 30, (0, 33)), (32, 32, (28, 33)), (31, 31, (28, 33)), (29, 29, (27, 32))],
)
def test_neighbours_of_the_lines_count_as_far_as_there_are_any_and_five_at_least(first, last, expected):
    assert StepBlocks(first=first, last=last, **CHOSEN).around == slice(*expected)


@pytest.mark.parametrize("overlap", [0.0, 0.5, 0.75])
def test_as_many_independent_averages_are_told_as_the_spectra_of_a_step_have(overlap):
    chosen = {"block_samples": 64, "overlap": overlap, "sample_rate": 100.0}
    averages = CrossSpectra(1, 1, **chosen)
    averages.add(*np.random.default_rng(1).standard_normal((2, 1, 501 + 64)))
    told = StepBlocks(first=4, last=20, **chosen).independent_averages(501)
    assert told == pytest.approx(averages.estimate().independent_averages)


def test_steps_are_weighed_by_their_age_and_brought_to_one_size():
    rng = np.random.default_rng(1)
    history, before = IterationHistory(target=np.ones((2, 501))), (np.zeros((2, 501)), np.zeros((1, 501)))
    expected = 0.0
    weight = np.array([1.0, 3.0])
    blocks = StepBlocks(first=4, last=20, **CHOSEN)
    for number in range(3):
        step_y, step_u = rng.standard_normal((2, 501)) * 10.0**-number, rng.standard_normal((1, 501))
        before = (before[0] + step_y, before[1] + step_u)
        history = history.after(Playback(response=before[0], drive=before[1]))
        padded = [np.pad(step, ((0, 0), (32, 32))) for step in (step_y, step_u)]
        power = np.mean(step_y**2, axis=1) @ weight**2 / 2.0
        expected = expected + 0.7 ** (2 - number) / power * cross_spectra(*padded, **CHOSEN)
    found = averaged_steps(seen_steps(history, blocks), forgetting=0.7, response_weight=weight)
    wanted = smooth_lines(expected)[4:21]
    np.testing.assert_allclose(found.response_with_drive, wanted, atol=1e-9 * np.abs(wanted).max())
    each = averaged_steps(seen_steps(history, blocks), forgetting=0.7, response_weight=weight, each_line=True)
    wanted = expected[4:21]
    np.testing.assert_allclose(each.response_with_drive, wanted, atol=1e-9 * np.abs(wanted).max())
