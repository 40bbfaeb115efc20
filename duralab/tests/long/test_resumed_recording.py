"""The recording of a campaign that was resumed into a new one: its first playbacks are steps without signals."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import synthetic_campaign

import duralab
from duralab.errors import InputError
from duralab_proto.v1 import iterator_pb2, recorder_pb2

EXAMPLE = Path(__file__).parents[3] / "examples" / "read_a_recording.py"


def resumed(path, campaign, *, taken_over, repeated=0):
    """Write one that took playbacks over from `demo`; the one that was repeated has a run with another name."""
    messages, runs = synthetic_campaign.steps(campaign), {}
    for message in messages:
        if isinstance(message, iterator_pb2.CampaignSpec):
            message.id, message.parent, message.parent_iteration = "demo-2", "demo", taken_over
        if isinstance(message, iterator_pb2.IterationStep) and message.iteration > taken_over:
            again = "-2" if message.iteration == repeated else ""
            runs[message.iteration] = message.run = f"demo-2.i{message.iteration:02d}{again}"
    # Whether a run of the parent was played is told in the parent's recording.
    messages = [message for message in messages if not isinstance(message, recorder_pb2.RunPlayed)]
    for number, run in runs.items():
        drive, response = campaign.drives[number - 1], campaign.responses[number - 1]
        if number == repeated:
            # What the rig played of it before it was stopped.
            messages += synthetic_campaign.signal_blocks(drive, response, run=run.removesuffix("-2"))[:5]
        messages += synthetic_campaign.signal_blocks(drive, response, run=run)
    return synthetic_campaign.write(path, messages)


def test_without_names_the_iterations_that_were_played_since_are_read(tmp_path, campaign):
    recording = duralab.open(resumed(tmp_path / "r.mcap", campaign, taken_over=2, repeated=4))
    responses = recording.responses()
    assert list(responses.run.values) == ["demo-2.i03", "demo-2.i04-2"]
    assert list(responses.iteration.values) == [3, 4]
    np.testing.assert_array_equal(responses.left_vertical[1], campaign.responses[3][0])
    np.testing.assert_array_equal(recording.drives().left_vertical[0], campaign.drives[2][0])
    assert recording.iterations.numbers == (1, 2, 3, 4)


def test_where_none_was_played_since_the_parent_is_named(tmp_path, campaign):
    recording = duralab.open(resumed(tmp_path / "r.mcap", campaign, taken_over=4))
    with pytest.raises(InputError, match=r"taken over; open the recording of its parent 'demo' for them\.$"):
        recording.responses()


def test_an_iteration_of_its_own_whose_signals_are_lost_is_not_left_out_in_silence(tmp_path, campaign):
    blocks = synthetic_campaign.signal_blocks(campaign.drives[0], campaign.responses[0], run="demo.i01")
    path = synthetic_campaign.write(tmp_path / "r.mcap", [*synthetic_campaign.steps(campaign), *blocks])
    with pytest.raises(InputError, match=r"no signals of a run 'demo.i02'; it holds demo.i01\.$"):
        duralab.open(path).responses()


def test_the_example_reads_one(tmp_path, campaign):
    path = resumed(tmp_path / "r.mcap", campaign, taken_over=2)
    done = subprocess.run([sys.executable, str(EXAMPLE), str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "most of the error of left_vertical is at" in done.stdout
