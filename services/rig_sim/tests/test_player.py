"""A playback: same seed, same bytes; blocks without seams; faults with a sentence; a ramp down that ends at zero."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest

import rig_sim.playing.player
from rig_sim import RigFaultError
from rig_sim.checks import LateProof, ProofError

TIME = np.arange(1234) / 1000.0


def moving(rig):
    frequencies = iter((2.0, 3.0, 5.0, 2.5, 3.5, 4.5))
    return np.array(
        [
            np.full_like(TIME, 15.0)
            if c.unit == "m/s"
            else 0.06 * c.maximum * np.sin(2 * np.pi * next(frequencies) * TIME)
            for c in rig.specimen.drives
        ]
    )


def played(rig, drive, seed=1):
    playback = rig.playback(drive, seed=seed)
    blocks = list(playback.blocks())
    return playback, blocks


def test_blocks_are_contiguous_and_make_up_drive_and_response(rig):
    drive = moving(rig)
    playback, blocks = played(rig, drive)
    assert [block.first_sample for block in blocks] == list(range(0, 1234, rig_sim.playing.player.BLOCK_SAMPLES))
    np.testing.assert_array_equal(np.hstack([block.drive for block in blocks]), drive)
    np.testing.assert_array_equal(np.hstack([block.response for block in blocks]), playback.response)
    assert playback.samples_done == 1234


@pytest.mark.parametrize("samples", [1, 7, 333, 5000])
def test_the_size_of_blocks_changes_no_bit(front_axle, monkeypatch, samples):
    whole, _ = played(front_axle, moving(front_axle))
    monkeypatch.setattr(rig_sim.playing.player, "BLOCK_SAMPLES", samples)
    other, blocks = played(front_axle, moving(front_axle))
    assert blocks[0].drive.shape == (6, min(samples, 1234))
    assert other.response.tobytes() == whole.response.tobytes()


def test_one_seed_gives_one_noise_and_another_seed_another(front_axle, quiet_front_axle):
    drive = np.zeros((6, 4000))
    first, again, other = (played(front_axle, drive, seed)[0].response for seed in (5, 5, 6))
    assert first.tobytes() == again.tobytes()
    noise = first - played(quiet_front_axle, drive)[0].response
    np.testing.assert_allclose(noise.std(axis=1), [c.noise_rms for c in front_axle.specimen.responses], rtol=0.05)
    correlation = np.corrcoef(np.vstack([noise, other - first + noise]))
    assert np.abs(correlation - np.eye(12)).max() < 0.08


SCRIPT = """
import hashlib, sys
import numpy as np
from rig_sim import load_rig, shipped_specimens
rig = load_rig(shipped_specimens()["front_axle"])
drive = np.frombuffer(sys.stdin.buffer.read()).reshape(6, -1)
playback = rig.playback(drive, seed=1)
for _ in playback.blocks():
    pass
sys.stdout.write(hashlib.sha256(playback.response.tobytes()).hexdigest() + rig.content_hash)
"""


def test_another_process_gives_the_same_bytes(front_axle):
    drive = moving(front_axle)
    answer = subprocess.run(
        [sys.executable, "-c", SCRIPT], input=drive.tobytes(), capture_output=True, check=True, timeout=120
    ).stdout.decode()
    response = played(front_axle, drive)[0].response
    assert answer == hashlib.sha256(response.tobytes()).hexdigest() + front_axle.content_hash


def fast_ramp(rig, channel, amplitude):
    """Return a drive beyond what `check_drive` lets through: the player has to notice by itself."""
    drive = np.zeros((6, 2000))
    drive[channel] = amplitude * np.minimum(TIME[-1] and np.arange(2000) / 1000.0, 1.0)
    return drive


def test_a_piston_at_its_end_stop_is_a_fault_with_actuator_and_time(front_axle):
    playback = front_axle.playback(fast_ramp(front_axle, 0, 0.2), seed=1)
    with pytest.raises(RigFaultError) as caught:
        list(playback.blocks())
    message = str(caught.value)
    assert message.startswith("the piston of left_vertical met its end stop (125 mm) at 0.6")
    assert message.endswith(" s; lower the drive.")
    # Nothing that is not physical was given out: the block with the fault is not part of the response.
    assert np.isfinite(playback.response[:, : playback.samples_done]).all()
    assert playback.samples_done % rig_sim.playing.player.BLOCK_SAMPLES == 0


def test_two_pistons_at_their_stops_are_both_named(front_axle):
    drive = fast_ramp(front_axle, 0, 0.2)
    drive[3] = drive[0]
    with pytest.raises(RigFaultError, match=r"piston of left_vertical met .* and the piston of right_vertical met"):
        list(front_axle.playback(drive, seed=1).blocks())


def test_a_motion_without_bounds_is_a_fault_and_never_data(predecessor):
    drive = np.zeros((8, 500))
    drive[1, 150:] = 1e250
    playback = predecessor.playback(drive, seed=1)
    with pytest.raises(RigFaultError, match=r"motion of predecessor became unbounded at 0\.15\d s"):
        list(playback.blocks())
    assert playback.samples_done == 100


def test_ramp_down_goes_on_from_where_the_drive_was_and_ends_at_zero(front_axle):
    drive = moving(front_axle)
    playback = front_axle.playback(drive, seed=1)
    blocks = playback.blocks()
    for _ in range(4):
        next(blocks)
    ramp = list(playback.ramp_down())
    assert ramp[0].first_sample == playback.samples_done == 400
    assert [block.first_sample for block in ramp[1:]] == [b.first_sample + b.drive.shape[1] for b in ramp[:-1]]
    command = np.hstack([block.drive for block in ramp])
    np.testing.assert_array_equal(command[:, 0], drive[:, 400])
    np.testing.assert_array_equal(command[:, -1], 0.0)
    assert np.all(np.diff(np.abs(command), axis=1) <= 0.0)
    response = np.hstack([block.response for block in ramp])
    assert np.isfinite(response).all()
    # The vertical actuators have an integral, the others give way to friction in rubber and seals: near the rest.
    static = front_axle.static_response
    assert np.abs(response[:, -50:].mean(axis=1) - static)[[0, 3]].max() < 0.1 * static[0]


def test_ramp_down_is_gentle_enough_for_the_slew_limits(front_axle):
    drive = np.array([[channel.maximum] for channel in front_axle.specimen.drives]) * np.minimum(TIME / 1.0, 0.6)
    playback, _ = played(front_axle, drive)
    command = np.hstack([block.drive for block in playback.ramp_down()])
    rate = np.abs(np.diff(command, axis=1)).max(axis=1) * 1000.0
    assert np.all(rate < [channel.slew_limit for channel in front_axle.specimen.drives])


def test_ramp_down_of_a_playback_that_has_not_begun_stays_at_rest(front_axle):
    playback = front_axle.playback(moving(front_axle) + 0.001, seed=1)
    assert all(not block.drive.any() for block in playback.ramp_down())


def test_uses_tell_peak_and_following_error(quiet_front_axle):
    drive = np.zeros((6, 2000))
    drive[0] = -0.0575 * np.sin(np.pi * np.arange(2000) / 2000) ** 2
    uses = {use.drive: use for use in played(quiet_front_axle, drive)[0].uses()}
    assert uses["left_vertical"].peak_command_ratio == pytest.approx(0.5, rel=1e-6)
    assert uses["right_lateral"].peak_command_ratio == 0.0
    assert all(use.saturated_share == 0.0 for use in uses.values())
    # A slow drive is followed closely where the loop is stiff; sideways the actuator gives way.
    assert 0.0 < uses["left_vertical"].largest_following_error < 3e-3


def test_uses_tell_a_valve_at_its_stop(quiet_front_axle):
    drive = np.zeros((6, 400))
    drive[0] = 0.02 * np.minimum(np.arange(400), 10) / 10.0
    use = played(quiet_front_axle, drive)[0].uses()[0]
    # 20 mm in 10 ms are as fast as the valve goes, and P = 50 /m is at its stop from 20 mm of error on.
    drive[0] *= 4.0
    faster = played(quiet_front_axle, drive)[0].uses()[0]
    assert faster.saturated_share > use.saturated_share
    assert faster.saturated_share > 0.02
    assert 0.02 < faster.largest_following_error < 0.08


@pytest.mark.parametrize("block_samples", [70, 1000])
def test_uses_do_not_depend_on_blocks_or_on_when_they_are_read(quiet_front_axle, block_samples):
    drive = np.zeros((6, 1100))
    drive[0] = 0.08 * np.minimum(np.arange(1100), 10) / 10.0
    expected = played(quiet_front_axle, drive)[0].uses()
    playback = quiet_front_axle.playback(drive, seed=1)
    playback.block_samples = block_samples
    read = [playback.uses() for _ in playback.blocks()]
    assert read[-1] == expected
    assert 0.0 < read[-1][0].saturated_share < read[0][0].saturated_share


def test_a_road_has_peaks_and_no_actuators(predecessor):
    drive = np.zeros((8, 500))
    drive[0] = 0.03 * np.sin(np.pi * np.arange(500) / 500) ** 2
    uses = played(predecessor, drive)[0].uses()
    assert uses[0].peak_command_ratio == pytest.approx(0.1, rel=1e-4)
    assert {(use.saturated_share, use.largest_following_error) for use in uses} == {(0.0, 0.0)}


def test_use_says_how_much_of_the_load_pressure_and_of_the_supply_was_left(quiet_front_axle):
    supply = quiet_front_axle.specimen.supply
    drive = np.zeros((6, 400))
    playback = quiet_front_axle.playback(drive, seed=1)
    for _ in playback.blocks():
        pass
    at_rest = {use.drive: use for use in playback.uses()}
    drive[0] = 0.03 * np.sin(2 * np.pi * 5.0 * np.arange(400) / 1000.0)
    playback = quiet_front_axle.playback(drive, seed=1)
    for _ in playback.blocks():
        pass
    moved = {use.drive: use for use in playback.uses()}
    # At rest the vertical actuator carries the strut: its force over what the supply presses with.
    carried = quiet_front_axle.static_response[0] / ((supply.supply_pressure - supply.return_pressure) * 2.0e-3)
    assert at_rest["left_vertical"].largest_load_pressure_share == pytest.approx(carried, rel=0.1)
    share = moved["left_vertical"].largest_load_pressure_share
    assert at_rest["left_vertical"].largest_load_pressure_share < share < 1.0
    assert {use.lowest_supply_pressure for use in moved.values()} == {supply.supply_pressure}


@pytest.mark.parametrize("error", [ProofError("the player disagrees."), ValueError("a shape is wrong")])
def test_a_late_proof_is_made_once_and_a_failed_one_is_raised_at_every_use(error):
    made = []

    def prove():
        made.append(True)
        raise error

    late = LateProof(prove)
    for _ in range(2):
        with pytest.raises(ProofError, match=str(error)):
            late.result()
    assert len(made) == 1
