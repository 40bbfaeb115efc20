"""Drives that begin and end away from zero: a ramp, a rest at the first sample, the drive itself, a ramp back."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from duralab_gateway.motion import Approach, lead_in, lead_out
from rig_sim import load_any_rig, shipped_specimens

FREE, SLOW = SimpleNamespace(slew_limit=0.0), SimpleNamespace(slew_limit=0.02)


def held(specimen, value, samples=1500):
    drive = np.zeros((len(specimen.drives), samples))
    drive[[0, 3]] = value
    return drive


def played(rig, drive, *, block_samples=100):
    playback = rig.playback(drive, seed=4)
    playback.block_samples = block_samples
    approach = list(playback.approach())
    blocks = list(playback.blocks())
    return playback, approach, blocks, list(playback.ramp_down())


def test_a_ramp_is_smooth_and_ends_in_the_first_sample_which_is_held():
    commands = lead_in(Approach(ramp=0.5, settle=0.25), np.array([2.0, -1.0]), [FREE, FREE], 1000.0)
    assert commands.shape == (2, 751)
    np.testing.assert_array_equal(commands[:, 0], 0.0)
    np.testing.assert_array_equal(commands[:, 500:], np.array([[2.0], [-1.0]]) * np.ones((1, 251)))
    # A raised cosine of height h in T: fastest at pi h / (2 T), in the middle.
    assert np.abs(np.diff(commands)).max() * 1000.0 == pytest.approx(np.pi * 2.0 / (2 * 0.5), rel=1e-3)


@pytest.mark.parametrize(("key", "longest"), [("ramp", 60.0), ("settle", 60.0), ("ramp_down", 10.0), ("hold", 10.0)])
def test_no_way_is_longer_than_somebody_waits_for_it(key, longest):
    assert getattr(Approach(**{key: longest}), key) == longest
    for value in (1.01 * longest, -0.1, np.nan):
        with pytest.raises(ValueError, match=key):
            Approach(**{key: value})


def test_a_slew_limit_makes_both_ramps_longer():
    up = lead_in(Approach(settle=0.0), np.array([0.1]), [SLOW], 1000.0)
    down = lead_out(Approach(hold=0.0), np.array([0.1]), [SLOW], 1000.0)
    for commands in (up, down):
        assert np.abs(np.diff(commands)).max() * 1000.0 == pytest.approx(SLOW.slew_limit, rel=1e-3)
        assert np.abs(np.diff(commands)).max() * 1000.0 <= SLOW.slew_limit
    assert down[0, -1] == 0.0


def test_nothing_is_ramped_where_the_drive_begins_at_zero_or_the_rig_may_step():
    assert lead_in(Approach(), np.zeros(2), [FREE, FREE], 1000.0).shape == (2, 1)
    np.testing.assert_array_equal(lead_in(Approach(ramp=0.0), np.ones(2), [FREE, FREE], 1000.0), np.ones((2, 1)))


def test_an_offset_drive_is_played_from_the_rest_at_its_first_sample(quiet_front_axle):
    rig = quiet_front_axle
    drive = held(rig.specimen, 0.02)
    playback, approach, blocks, ramp = played(rig, drive)
    # Before the drive: samples below zero, without a gap, up to its first one.
    assert approach[0].first_sample == -2000
    assert [block.end for block in approach] == [block.first_sample for block in [*approach[1:], blocks[0]]]
    np.testing.assert_array_equal(np.hstack([block.drive for block in blocks]), drive)
    # The returned response is that of the drive's samples only, and the axle rests there: little is left of the ramp.
    assert playback.response.shape == (6, 1500)
    settled = np.ptp(playback.response, axis=1)
    assert settled.max() < 0.05 * np.abs(playback.response[0, -1] - rig.static_response[0])
    assert playback.response[0, 0] > rig.static_response[0] + 500.0
    # Back to zero, and to the forces at rest.
    assert playback.rests_at_zero
    assert not ramp[-1].drive.any()
    assert [block.first_sample for block in ramp] == list(range(1500, 2100, 100))


def test_ramps_are_no_part_of_what_is_told_of_the_actuators(quiet_front_axle):
    playback, approach, *_ = played(quiet_front_axle, held(quiet_front_axle.specimen, 0.02))
    moving = max(np.abs(block.following_error[0]).max() for block in approach)
    assert playback.uses()[0].largest_following_error < 0.1 * moving


@pytest.mark.parametrize("block_samples", [7, 20, 100, 5000])
def test_the_size_of_blocks_changes_no_bit_of_an_offset_drive(front_axle, block_samples):
    drive = held(front_axle.specimen, 0.01, 300)
    whole = played(front_axle, drive)[0].response
    assert played(front_axle, drive, block_samples=block_samples)[0].response.tobytes() == whole.tobytes()
    # Who does not iterate over the approach gets it all the same.
    playback = front_axle.playback(drive, seed=4)
    for _ in playback.blocks():
        pass
    assert playback.response.tobytes() == whole.tobytes()


def test_a_drive_from_zero_to_zero_is_played_as_it_stands(front_axle):
    drive = held(front_axle.specimen, 0.0, 300)
    drive[0, 1:-1] = 1e-3
    playback = front_axle.playback(drive, seed=4)
    assert list(playback.approach()) == []
    for _ in playback.blocks():
        pass
    assert playback.rests_at_zero


def test_a_stop_on_the_way_to_the_first_sample_turns_back_from_there(front_axle):
    playback = front_axle.playback(held(front_axle.specimen, 0.02), seed=4)
    approach = playback.approach()
    half = [next(approach) for _ in range(5)]
    ramp = list(playback.ramp_down())
    assert ramp[0].first_sample == half[-1].end == -1500
    command = np.hstack([block.drive for block in [*half, *ramp]])
    assert command[0].max() == pytest.approx(0.01, rel=1e-3)
    assert np.abs(np.diff(command)).max() * 1000.0 < 0.1
    assert not command[:, -1].any()
    assert playback.samples_done == 0


def test_a_structure_is_approached_as_well():
    rig = load_any_rig(shipped_specimens()["aerospace"])
    rig = dataclasses.replace(rig, specimen=rig.specimen.model_copy(update={"approach": Approach(settle=0.5)}))
    drive = held(rig.specimen, 2.0, 400)
    playback, approach, blocks, ramp = played(rig, drive)
    assert (approach[0].first_sample, blocks[0].first_sample, ramp[0].first_sample) == (-768, 0, 400)
    assert np.abs(playback.response).max() < 2.0 * np.abs(rig.sampled_frf(np.array([5.4]))).sum()
    assert not ramp[-1].drive.any()
