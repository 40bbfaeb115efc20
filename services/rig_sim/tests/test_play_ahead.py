"""A simulation ahead of the clock plays long blocks, and ends a run where usual blocks would have ended it."""

from itertools import chain

import numpy as np
import pytest

from duralab_gateway.motion import RigFaultError

USUAL, LONG = 100, 600


def play(playback, ends_run, *, ahead):
    """Play until a block ends the run, then to rest; return all blocks, and those of the ramp."""
    if ahead:
        playback.play_ahead(LONG, ends_run)
    blocks = []
    for block in chain(playback.approach(), playback.blocks()):
        blocks.append(block)
        if ends_run(block):
            break
    return blocks, list(playback.ramp_down())


def whole(blocks, what):
    return np.hstack([getattr(block, what) for block in blocks])


def assert_same(found, expected):
    for what in ("drive", "response", "following_error", "monitored"):
        assert whole(found, what).tobytes() == whole(expected, what).tobytes()
    assert found[-1].end == expected[-1].end


def offset_wave(samples=2350):
    seconds = np.arange(samples) / 1000.0
    return 0.01 * np.cos(2.0 * np.pi * np.outer([1.0, 0.3, 0.2, 0.9, 0.2, 0.3], seconds))


@pytest.mark.parametrize("last", [10_000, 1234, -150], ids=["not at all", "in the drive", "in the approach"])
def test_a_run_is_the_same_and_ends_at_the_same_sample(front_axle_compliant, last):
    def ends_run(block):
        return block.first_sample <= last < block.end

    usual, ahead = (front_axle_compliant.playback(offset_wave(), seed=4) for _ in range(2))
    expected, expected_ramp = play(usual, ends_run, ahead=False)
    found, found_ramp = play(ahead, ends_run, ahead=True)
    assert len(found) < len(expected)
    assert_same(found, expected)
    assert_same(found_ramp, expected_ramp)
    assert len(found_ramp) == len(expected_ramp)
    assert ahead.uses() == usual.uses()
    assert ahead.samples_moved == usual.samples_moved


def test_a_piston_at_its_end_stop_ends_the_run_after_the_same_samples(front_axle_compliant):
    drive = np.zeros((6, 3000))
    drive[0] = np.linspace(0.0, 0.6, 3000)
    ends = []
    for ahead in (False, True):
        playback = front_axle_compliant.playback(drive, seed=4)
        if ahead:
            playback.play_ahead(LONG, lambda _block: False)
        blocks = []
        with pytest.raises(RigFaultError, match="end stop") as caught:
            blocks.extend(iter(playback.blocks()))
        ends.append((str(caught.value), playback.samples_done, playback.response[:, : playback.samples_done].tobytes()))
    assert ends[0] == ends[1]


def test_the_rig_is_shown_at_the_end_of_each_usual_block(front_axle_compliant):
    drive = offset_wave(1250)
    usual, ahead = (front_axle_compliant.playback(drive, seed=4) for _ in range(2))
    ahead.play_ahead(LONG, lambda _block: False)
    expected, found = (
        [(instants := playback.instants(), playback.frames(instants)) for _ in playback.blocks()]
        for playback in (usual, ahead)
    )
    assert [instant for instants, _ in found for instant in instants] == [*range(USUAL, 1250, USUAL), 1250]
    assert len(found) < len(expected)
    np.testing.assert_array_equal(*(np.concatenate([shown for _, shown in each]) for each in (found, expected)))
