"""Figures of the responses of a running test: what a dashboard shows."""

import numpy as np
import pytest

from duralab_proto.arrays import to_array
from duralab_proto.v1 import sequencer_pb2
from sequencer.channel_figures import correction_damage_ratio, damage_ratio, residual


def status(**arrays):
    made = {name: to_array(np.array(values, dtype=np.float64)) for name, values in arrays.items()}
    return sequencer_pb2.EnduranceStatus(
        responses=["left", "right"], columns=["rms", "residual static", "residual 1 to 2 Hz"], **made
    )


def test_damage_is_told_over_what_was_planned_of_it():
    found = damage_ratio(status(damage=[6.0, 4.0], damage_planned_so_far=[3.0, 0.0]))
    assert found == {"left": 2.0}
    assert damage_ratio(status(damage=[6.0, 4.0])) == {}


def test_the_residual_is_that_of_all_bands_together():
    found = residual(status(last_statistics=[[100.0, 0.03, 0.04], [100.0, np.nan, 0.1]]))
    assert found == pytest.approx({"left": 0.05})
    assert residual(status()) == {}


def test_the_damage_of_corrections_is_told_over_the_same_planned_damage():
    found = correction_damage_ratio(status(correction_damage=[0.3, 4.0], damage_planned_so_far=[3.0, 0.0]))
    assert found == pytest.approx({"left": 0.1})
    assert correction_damage_ratio(status(correction_damage=[0.3, 4.0])) == {}
