"""A sweep of thousands: planned, forecast from what has ended, and run in part; nobody runs a campaign here."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import pytest
import yaml
from test_cli import invoke

from duralab.errors import InputError
from duralab.sweeps import forecast_sweep, load_sweep, run_sweep
from duralab.sweeps.cluster import PointRunner
from duralab.sweeps.points import PointMaker, grid
from duralab.sweeps.results import POINTS, Costs, Outcome, State, write_outcome


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "mine.yaml"
    axes = {
        "seed": {"from": 1, "count": 10},
        "specimen.front_axle.struts.left_strut.law.stiffness": {"scale": [0.9, 1.1]},
    }
    path.write_text(yaml.safe_dump({"name": "mine", "campaign": "front_axle_demo", "axes": axes}))
    return path


def end(file, folder, *, finished, failed=0):
    """Write the outcomes of the first points as workers do: each took 3 s with its cell, and keeps 20 MB."""
    maker, plan = PointMaker(load_sweep(file)), load_sweep(file)
    ids = [maker.make(settings).id for settings in grid(plan)]
    for number, id in enumerate(ids[: finished + failed]):
        place = folder / POINTS / id
        place.mkdir(parents=True)
        state = State.FINISHED if number < finished else State.FAILED
        write_outcome(Outcome(id, state, "said", costs=Costs(cell=1.0, campaign=2.0), bytes=20_000_000), place)
    return ids


def test_a_forecast_is_of_what_has_finished(file, tmp_path):
    end(file, tmp_path / "out", finished=4, failed=1)
    found = forecast_sweep(file, out=tmp_path / "out", workers=5)
    assert (found.total, found.ended, found.failed) == (20, 5, 1)
    assert found.seconds_left == pytest.approx(15 * 3.0 / 5)
    assert found.bytes_left == 15 * 20_000_000
    assert found.free_bytes > 0


def test_nothing_is_forecast_before_a_campaign_has_finished(file, tmp_path):
    code, said, _ = invoke("sweep", str(file), "--forecast", "--out", str(tmp_path / "out"))
    assert code == 0
    assert "20 campaigns: 0 have ended" in said
    assert "run some first: --at-most 8" in said
    assert not (tmp_path / "out").exists()


def test_the_forecast_is_shown_in_words(file, tmp_path):
    end(file, tmp_path / "out", finished=2)
    code, said, _ = invoke("sweep", str(file), "--forecast", "--workers", "2", "--out", str(tmp_path / "out"))
    assert code == 0
    assert "A campaign takes 3.0 s on a worker and keeps 20.0 MB: the remaining 18 take 0:00:27 on 2 workers" in said


@pytest.mark.parametrize("option", [["--at-most", "3"], ["--scheduler", "tcp://head:8786"]])
def test_a_forecast_runs_nothing(file, option):
    code, _, error = invoke("sweep", str(file), "--forecast", *option)
    assert code == 2
    assert "leave out --at-most and --scheduler" in error


def test_a_search_has_its_budget_and_no_forecast():
    with pytest.raises(InputError, match=r"at_most is 3, and sweep 'search_for_gain_and_blocks' is a search"):
        run_sweep("search_for_gain_and_blocks", at_most=3)
    with pytest.raises(InputError, match=r"a forecast is made for a grid"):
        forecast_sweep("search_for_gain_and_blocks")


def test_only_so_many_of_those_that_remain_are_run(file, tmp_path, monkeypatch):
    ids = end(file, tmp_path / "out", finished=4)
    plan = load_sweep(file)
    asked: list[str] = []

    def outcomes(_self: object, waiting: deque) -> list:
        asked.extend(point.id for point in waiting)
        return [(point, Outcome(point.id, State.FINISHED, "said")) for point in waiting]

    monkeypatch.setattr(PointRunner, "_outcomes", outcomes)
    runner = PointRunner(lambda: None, plan, folder=tmp_path / "out", retry_failed=False, at_most=3)
    maker = PointMaker(plan)
    ended = list(runner.run([maker.make(settings) for settings in grid(plan)]))
    assert asked == ids[4:7]
    assert len(ended) == 7
