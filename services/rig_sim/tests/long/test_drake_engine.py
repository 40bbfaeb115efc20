"""The engine `drake`: the compiled player arrives where Drake does, and both play alike to whoever asks."""

from itertools import cycle

import numpy as np
import pytest
from pydantic import ValidationError

import rig_sim.playing.player
from rig_sim import EngineChoice, RigFaultError, load_rig, shipped_specimens
from rig_sim.compile import Method
from rig_sim.engines.drake_engine import DrakeEngine
from rig_sim.multibody.drake_reader import load_plant
from rig_sim.specimen.specimen import read_document

RATE = 1000.0
MULTIBODY_RIGS = sorted(name for name, path in shipped_specimens().items() if "sdf" in read_document(path))
DRAKE = EngineChoice.model_validate("drake")


@pytest.fixture(scope="module", params=["front_axle_by_drake", "predecessor_by_drake"])
def judged(request):
    return request.getfixturevalue(request.param)


def smooth(rig, samples, share=0.06):
    """Return a drive (drives, samples) with a smooth beginning: 7 mm at 6 to 13 Hz, or a road at 15 m/s."""
    time = np.arange(samples) / RATE
    begin = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time / 0.05, 1.0))
    frequencies = cycle((6.0, 9.0, 12.0, 7.0, 10.0, 13.0))
    return np.array(
        [
            begin * (15.0 if c.unit == "m/s" else share * c.maximum * np.sin(2 * np.pi * next(frequencies) * time))
            for c in rig.specimen.drives
        ]
    )


def advance(rig, player, drive, substeps=None, method=None):
    played = player.play(
        rig.rest,
        drive,
        sample_interval=1.0 / RATE,
        substeps=substeps or rig.specimen.substeps,
        method=method or rig.specimen.integrator,
        bounds=np.full(len(rig.rest), np.finfo(float).max),
    )
    assert played.diverged_at is None
    return played


def drake(rig, **options):
    plant = load_plant(shipped_specimens()[rig.specimen.name].with_name(rig.specimen.sdf))
    return DrakeEngine(rig.model, plant, EngineChoice(engine=DRAKE.engine, **options))


def rms(values):
    return np.sqrt(np.mean(values**2, axis=1))


def test_the_player_arrives_where_drake_does(judged):
    drive = smooth(judged, 321)
    ours, theirs = (advance(judged, player, drive) for player in (judged.compiled, judged.player))
    forces = slice(0, len(judged.specimen.responses))
    # Forces at every sample, to a thousandth of the largest of their channel.
    largest = np.abs(theirs.outputs[forces]).max(axis=1)
    assert np.all(np.abs(ours.outputs - theirs.outputs)[forces].max(axis=1) < 1e-3 * largest)
    # Their dynamic part alone, and whatever is monitored: strokes, valves, pressures.
    assert np.all(rms(ours.outputs - theirs.outputs) < 1e-3 * rms(theirs.outputs))
    moved = rms(theirs.outputs[forces] - judged.static_response[:, None])
    assert moved.min() > 100.0
    assert np.all(rms((ours.outputs - theirs.outputs)[forces]) < 1.5e-3 * moved)
    # All states at the end, those included that nobody monitors: tree, chambers, spools, friction.
    n_q = judged.model.position_count
    n_v = judged.model.assembly.tree.velocity_count
    for name, part in (
        ("positions", slice(0, n_q)),
        ("velocities", slice(n_q, n_q + n_v)),
        ("elements", slice(n_q + n_v, None)),
    ):
        travel = np.abs(theirs.state[part] - judged.rest[part]).max()
        assert travel > 0.0
        assert np.abs(theirs.state[part] - ours.state[part]).max() < 2e-3 * travel, name


@pytest.mark.parametrize("name", MULTIBODY_RIGS)
def test_every_shipped_rig_plays_with_drake_as_it_does_compiled(name):
    rig = load_rig(shipped_specimens()[name], DRAKE)
    drive = smooth(rig, 41, share=0.04)
    # Nothing is lost of a specimen that wears: its other inputs are 0.
    drive = np.vstack([drive, np.zeros((len(rig.model.input_names) - len(drive), drive.shape[1]))])
    ours, theirs = (advance(rig, player, drive).outputs for player in (rig.compiled, rig.player))
    moved = np.abs(theirs - theirs[:, :1]).max(axis=1)
    assert np.all(moved[: len(rig.specimen.responses)] > 0.0)
    # Accelerations ring with the stiffest bushings and are twice as far off as forces; all others keep to 1e-3.
    units = [getattr(channel, "unit", "N") for channel in rig.specimen.responses]
    allowed = [2e-3 if unit == "m/s^2" else 1e-3 for unit in units] + [1e-3] * (len(ours) - len(units))
    assert np.all(rms(ours - theirs) <= allowed * rms(theirs))


def test_the_difference_falls_with_the_players_order(judged):
    """Runge-Kutta 4, whose errors stand out, against a tight Drake, over a stretch in which friction has few kinks."""
    drive = smooth(judged, 61, share=0.02)
    reference = advance(judged, drake(judged, accuracy=1e-7), drive).outputs
    # At one step a sample the front axle's bushings are beyond the stability of the method.
    steps = {"front_axle_compliant": (2, 4), "predecessor": (1, 2, 4)}[judged.specimen.name]
    forces = slice(0, len(judged.specimen.responses))
    errors = [
        (rms((played.outputs - reference)[forces]) / rms(reference[forces])).max()
        for played in (advance(judged, judged.compiled, drive, n, Method.RUNGE_KUTTA_4) for n in steps)
    ]
    assert errors[0] < 1e-3
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 3.3)


def test_drake_agrees_with_itself_at_another_accuracy_and_with_fixed_steps(judged):
    drive = smooth(judged, 31)
    tight = advance(judged, drake(judged, accuracy=1e-7), drive).outputs
    for options, allowed in (({}, 2e-4), ({"fixed_step": 1.25e-4}, 2e-4)):
        loose = advance(judged, drake(judged, **options), drive).outputs
        assert 0.0 < (rms(loose - tight) / rms(tight)).max() < allowed


def test_blocks_are_contiguous_and_their_size_changes_no_bit(front_axle_by_drake, monkeypatch):
    rig = front_axle_by_drake
    drive = smooth(rig, 47)

    def played():
        playback = rig.playback(drive, seed=3)
        return playback, list(playback.blocks())

    playback, blocks = played()
    assert rig.block_samples == 20
    assert [block.first_sample for block in blocks] == [0, 20, 40]
    np.testing.assert_array_equal(np.hstack([block.drive for block in blocks]), drive)
    np.testing.assert_array_equal(np.hstack([block.response for block in blocks]), playback.response)
    assert [use.drive for use in playback.uses()] == list(rig.model.input_names)
    assert playback.uses()[0].largest_following_error > 0.0
    monkeypatch.setattr(rig_sim.playing.player, "DRAKE_BLOCK_SAMPLES", 9)
    again, blocks = played()
    assert len(blocks) == 6
    assert again.response.tobytes() == playback.response.tobytes()
    assert again.uses() == playback.uses()


def test_two_playbacks_taken_in_turns_do_not_disturb_each_other(front_axle_by_drake):
    drive = smooth(front_axle_by_drake, 41)
    alone = front_axle_by_drake.playback(drive, seed=1)
    assert len(list(alone.blocks())) == 3
    pair = [front_axle_by_drake.playback(sign * drive, seed=1) for sign in (1.0, -1.0)]
    for _ in zip(*(playback.blocks() for playback in pair), strict=True):
        pass
    assert pair[0].response.tobytes() == alone.response.tobytes()
    assert pair[1].response.tobytes() != alone.response.tobytes()


def test_ramp_down_goes_on_from_where_the_playback_was_left(front_axle_by_drake):
    drive = smooth(front_axle_by_drake, 200)
    playback = front_axle_by_drake.playback(drive, seed=1)
    next(playback.blocks())
    ramp = list(playback.ramp_down())
    assert ramp[0].first_sample == 20
    assert [block.first_sample for block in ramp[1:]] == [b.first_sample + b.drive.shape[1] for b in ramp[:-1]]
    np.testing.assert_array_equal(ramp[0].drive[:, 0], drive[:, 20])
    np.testing.assert_array_equal(ramp[-1].drive[:, -1], 0.0)
    assert np.isfinite(np.hstack([block.response for block in ramp])).all()


def test_a_motion_that_drake_cannot_follow_is_a_fault_and_never_data(predecessor_by_drake):
    drive = np.zeros((8, 100))
    drive[1, 50:] = 1e250
    playback = predecessor_by_drake.playback(drive, seed=1)
    with pytest.raises(RigFaultError, match=r"motion of predecessor became unbounded at 0\.05\d s"):
        list(playback.blocks())
    assert playback.samples_done == 40
    assert np.isfinite(playback.response[:, :40]).all()


def test_states_out_of_bounds_are_named_before_anything_moves(front_axle_by_drake):
    rig = front_axle_by_drake
    joint = rig.model.assembly.elements[0].joint_position
    start, bounds = rig.rest.copy(), np.full(len(rig.rest), np.finfo(float).max)
    start[joint], bounds[joint] = 0.12, 0.1
    played = rig.player.play(start, np.zeros((6, 41)), sample_interval=1e-3, substeps=2, bounds=bounds)
    assert (played.diverged_at, played.diverged_states) == (0, (rig.model.state_names[joint],))
    assert played.outputs.shape[1] == 0


def test_the_hash_tells_engines_and_accuracies_apart(front_axle_compliant, front_axle_by_drake):
    tight = EngineChoice(engine=DRAKE.engine, accuracy=1e-6)
    other = load_rig(shipped_specimens()["front_axle_compliant"], tight)
    assert len({front_axle_compliant.content_hash, front_axle_by_drake.content_hash, other.content_hash}) == 3
    np.testing.assert_array_equal(front_axle_by_drake.static_response, front_axle_compliant.static_response)


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ("dracke", "Input should be 'compiled' or 'drake'"),
        ({"engine": "compiled", "accuracy": 1e-5}, "accuracy is for the engine drake"),
        ({"engine": "drake", "accuracy": 1e-5, "fixed_step": 1e-4}, "accuracy and fixed_step are both given"),
        ({"engine": "drake", "accuracy": 1.0}, "less than or equal to 0.01"),
        ({"engine": "drake", "fixed_step": 0.0}, "greater than 0"),
        ({"engine": "drake", "substeps": 4}, "Extra inputs are not permitted"),
    ],
)
def test_a_bad_choice_of_an_engine_is_refused(choice, said):
    with pytest.raises(ValidationError, match=said):
        EngineChoice.model_validate(choice)


def test_a_step_longer_than_a_sample_is_refused(front_axle_compliant):
    with pytest.raises(ValueError, match=r"fixed_step is 0\.002 s; a sample, 0\.001 s, is the longest"):
        drake(front_axle_compliant, fixed_step=2e-3)
