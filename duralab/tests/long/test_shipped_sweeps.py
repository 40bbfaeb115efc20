"""Sweeps that ship or stand in the guide: all their points are allowed."""

import re
from pathlib import Path

from duralab.sweeps import load_sweep, shipped_sweeps
from duralab.sweeps.points import PointMaker, grid, grid_size


def identities(plan):
    maker = PointMaker(plan)
    return [maker.make(settings).id for settings in grid(plan)]


def test_the_shipped_sweeps_have_points_that_are_allowed():
    for name in shipped_sweeps():
        plan = load_sweep(name)
        assert len(identities(plan)) == grid_size(plan)
    assert grid_size(load_sweep("fifty_gains_and_seeds")) == 50
    assert grid_size(load_sweep("thousand_tolerances")) == 1000


def test_the_sweeps_of_the_guide_are_allowed(tmp_path):
    text = (Path(__file__).parents[3] / "docs" / "guides" / "sweeps.md").read_text(encoding="utf-8")
    found = re.findall(r"```yaml part-of=sweep\n(.*?)```", text, flags=re.DOTALL)
    assert len(found) == 2
    for content in found:
        (tmp_path / "sweep.yaml").write_text(content)
        plan = load_sweep(tmp_path / "sweep.yaml")
        assert len(set(identities(plan))) == grid_size(plan)
