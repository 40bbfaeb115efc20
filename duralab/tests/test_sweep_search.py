"""A search finds the smallest figure, and takes the same way at once or after a break."""

from __future__ import annotations

import importlib

import pytest
import yaml

from duralab.errors import InputError
from duralab.sweeps import load_sweep
from duralab.sweeps.points import PointMaker
from duralab.sweeps.results import Outcome, State
from duralab.sweeps.sweeping import search

SECTION = {
    "settings": {
        "update.iteration_gain": {"from": 0.1, "to": 1.0},
        "excitation.capture_blocks": {"from": 1, "to": 4, "whole": True},
        "estimator.block_samples": {"choices": [1024, 2048]},
    },
    "budget": 24,
    "seed": 5,
    "startup": 8,
    "together": 3,
}


class FakeRunner:
    """Answers at once: a bowl with its ground at a gain of 0.62 and blocks of 1024."""

    def __init__(self, *, fails=(), breaks_after=None):
        self.ran, self.fails, self.breaks_after = [], fails, breaks_after

    def run(self, points):
        for point in points:
            if self.breaks_after is not None and len(self.ran) >= self.breaks_after:
                raise KeyboardInterrupt
            number = len(self.ran)
            self.ran.append(point.id)
            if number in self.fails:
                yield point, Outcome(point.id, State.FAILED, "The rig is out.")
                continue
            gain, block = point.settings["update.iteration_gain"], point.settings["estimator.block_samples"]
            error = (gain - 0.62) ** 2 + 0.2 * (block != 1024) + 0.001 * point.settings.get("seed", 0)
            yield point, Outcome(point.id, State.FINISHED, "Done.", overall_error=error, worst_error=error)


@pytest.fixture
def plan(tmp_path):
    def make(**sections):
        path = tmp_path / "sweep.yaml"
        path.write_text(yaml.safe_dump({"name": "s", "campaign": "front_axle_demo", "search": SECTION, **sections}))
        return load_sweep(path)

    return make


def run(plan, folder, runner):
    folder.mkdir(exist_ok=True)
    return list(search(plan, PointMaker(plan), runner, folder=folder))


def test_a_search_ends_near_the_ground_and_keeps_its_budget(plan, tmp_path):
    ended = run(plan(), tmp_path / "a", FakeRunner())
    assert len(ended) == SECTION["budget"]
    best_point, _ = min(ended, key=lambda pair: pair[1].overall_error)
    assert abs(best_point.settings["update.iteration_gain"] - 0.62) < 0.1
    assert best_point.settings["estimator.block_samples"] == 1024
    # It learns: the second half is better than the random first.
    errors = [outcome.overall_error for _, outcome in ended]
    assert sum(errors[12:]) < sum(errors[:12])


def test_a_search_that_was_broken_off_goes_the_same_way(plan, tmp_path):
    straight = [point.settings for point, _ in run(plan(), tmp_path / "a", FakeRunner())]
    with pytest.raises(KeyboardInterrupt):
        run(plan(), tmp_path / "b", FakeRunner(breaks_after=13))
    # What had ended is given again, from the start, by the runner that knows it; here it is computed anew.
    assert [point.settings for point, _ in run(plan(), tmp_path / "b", FakeRunner())] == straight


def test_a_failed_trial_stops_nothing(plan, tmp_path):
    ended = run(plan(), tmp_path / "a", FakeRunner(fails=(0, 5)))
    assert len(ended) == SECTION["budget"]
    assert [outcome.state for _, outcome in ended].count(State.FAILED) == 2


def test_with_axes_each_trial_runs_at_every_point(plan, tmp_path):
    both = plan(axes={"seed": {"from": 1, "count": 2}})
    ended = run(both, tmp_path / "a", FakeRunner())
    assert len(ended) == SECTION["budget"]
    pairs = [point.settings for point, _ in ended]
    assert {row["seed"] for row in pairs} == {1, 2}
    assert len({row["update.iteration_gain"] for row in pairs}) == SECTION["budget"] // 2


def test_a_budget_below_one_trial_is_refused(plan, tmp_path):
    with pytest.raises(InputError, match=r"search\.budget is 24"):
        run(plan(axes={"seed": {"from": 1, "count": 25}}), tmp_path / "a", FakeRunner())


def test_axes_with_too_many_points_are_refused_before_they_are_made(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(
        importlib.import_module("duralab.sweeps.sweeping"), "grid", lambda _: pytest.fail("It is made.")
    )
    both = plan(axes={key: {"from": 1, "count": 100_000} for key in ("seed", "excitation.repeats")})
    with pytest.raises(InputError, match=r"10000000000 points; 100000 are allowed"):
        run(both, tmp_path / "a", FakeRunner())


def test_a_bound_that_the_campaign_does_not_allow_is_found_first(plan, tmp_path):
    wrong = plan(search={**SECTION, "settings": {"update.iteration_gain": {"from": 0.5, "to": 2.0}}})
    runner = FakeRunner()
    with pytest.raises(InputError, match=r"update\.iteration_gain"):
        run(wrong, tmp_path / "a", runner)
    assert runner.ran == []
