"""Drives of an endurance test against the limits of its rig, before anything moves."""

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.arrays import to_record
from duralab_proto.v1 import sequencer_pb2
from sequencer.endurance.plan import plan_endurance

from .one_rig_lab import DESCRIPTION, DRIVE, RATE, RIG, SAMPLES

SLEW_LIMIT = DESCRIPTION.drives[0].slew_limit


def planned(drive):
    """Return the plan of two events, of which the second has this drive."""
    schedule = f"""
name: weeks
rig: {RIG}
events:
  smooth: {{drive: smooth.csv, repeats: 3}}
  rough: {{drive: rough.csv, repeats: 3}}
monitoring: {{bands: [2, 8, 40]}}
"""
    spec = sequencer_pb2.EnduranceSpec(id="weeks", rig=RIG, schedule=schedule)
    for name, samples in (("smooth", DRIVE), ("rough", drive)):
        spec.events.add(name=name, drive=to_record(DESCRIPTION.drives, RATE, samples))
    return plan_endurance(spec, DESCRIPTION)


def with_step(step, *, at):
    drive = np.zeros((1, SAMPLES))
    drive[0, at:] = step
    return drive


def test_a_drive_beyond_the_slew_limit_is_refused_with_the_name_of_its_event():
    step = SLEW_LIMIT / RATE
    planned(with_step(0.99 * step, at=50))
    wanted = (
        r"The drive of event 'rough' moves at 1\.01 m/s in stroke at 0\.500 s; the rig allows 1: make a slower one\."
    )
    with pytest.raises(FaultError, match=wanted) as refused:
        planned(with_step(-1.01 * step, at=50))
    assert refused.value.field == "events[1].drive"


def test_the_way_to_the_first_sample_is_not_a_step_of_the_drive():
    planned(np.full((1, SAMPLES), 0.09))


def test_a_drive_beyond_the_peak_limit_is_refused_with_the_name_of_its_event():
    with pytest.raises(
        FaultError, match=r"The drive of event 'rough' goes from 0\.11 to 0\.11 m in stroke; the rig allows"
    ):
        planned(np.full((1, SAMPLES), 0.11))
