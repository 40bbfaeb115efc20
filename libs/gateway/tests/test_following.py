"""The playback of a controller that follows commands, without a bus."""

from types import SimpleNamespace

import numpy as np
import pytest

from duralab_gateway.motion import Approach, FollowedDrive, RigFaultError

CHANNELS = [SimpleNamespace(name=name, minimum=-0.2, maximum=0.1, slew_limit=0.0) for name in "ab"]


def followed(follow, drive, *, stopped=lambda: False, block_samples=20, approach=Approach(ramp=0.1, settle=0.1)):  # noqa: B008
    return FollowedDrive(
        follow,
        drive,
        channels=CHANNELS,
        response_names=["left", "right"],
        approach=approach,
        sample_rate=100.0,
        block_samples=block_samples,
        stopped=stopped,
    )


def test_each_command_is_given_once_and_in_order_and_each_answer_kept():
    given = []
    drive = 0.05 * np.random.default_rng(1).uniform(-1.0, 1.0, (2, 90))
    playback = followed(lambda commands: given.append(commands) or 3.0 * commands, drive)
    approach = list(playback.approach())
    blocks = list(playback.blocks())
    down = list(playback.ramp_down())
    np.testing.assert_array_equal(np.hstack(given), np.hstack([b.drive for b in [*approach, *blocks, *down]]))
    np.testing.assert_array_equal(np.hstack([block.drive for block in blocks]), drive)
    np.testing.assert_array_equal(playback.response, 3.0 * drive)
    assert [block.first_sample for block in [*approach, *blocks, *down]][:: len(approach)][:2] == [-20, 0]
    assert (down[-1].drive[:, -1] == 0.0).all()


def test_the_use_of_a_drive_is_its_peak_over_the_limit_in_that_direction():
    drive = np.array([[0.0, 0.05, 0.0], [0.0, -0.05, 0.0]])
    playback = followed(lambda commands: commands, drive)
    list(playback.blocks())
    assert [(use.drive, use.peak_command_ratio) for use in playback.uses()] == [("a", 0.5), ("b", 0.25)]


def test_what_a_controller_does_with_its_commands_does_not_change_the_drive():
    def spoiling(commands):
        commands[:] = 7.0
        return commands

    drive = np.zeros((2, 40))
    blocks = list(followed(spoiling, drive).blocks())
    assert (np.hstack([block.drive for block in blocks]) == 0.0).all()


def test_a_stopped_piece_may_end_early_and_the_way_down_begins_there():
    stopped = []

    def half(commands):
        stopped.append(True)
        return commands[:, :5]

    drive = np.linspace(0.0, 0.09, 40) * np.ones((2, 1))
    playback = followed(half, drive, stopped=lambda: bool(stopped))
    block = next(playback.blocks())
    assert block.drive.shape == (2, 5)
    playback._follow = lambda commands: commands
    down = next(playback.ramp_down())
    assert down.first_sample == 5
    np.testing.assert_allclose(down.drive[:, 0], drive[:, 5])


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (np.zeros(20), r"array of shape \(20,\) at 0\.000 s; \(2, 20\) was commanded"),
        (np.zeros((2, 21)), r"array of shape \(2, 21\)"),
        (np.zeros((2, 19)), r"measured 19 of 20 samples at 0\.000 s, and it was not stopped"),
        (np.full((2, 20), np.inf), r"the response of left is inf at 0\.000 s; every value must be finite"),
    ],
)
def test_an_answer_that_cannot_be_is_refused(answer, sentence):
    playback = followed(lambda _commands: answer, np.zeros((2, 40)))
    with pytest.raises(RigFaultError, match=sentence):
        next(playback.blocks())
