import hashlib

import numpy as np
import pytest
import synthetic_campaign

from duralab.errors import InputError
from duralab.recording import open_recording
from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2, recorder_pb2


def test_figures_equal_those_that_were_written(recording_path, campaign):
    table = open_recording(recording_path).iterations
    assert table.channels == synthetic_campaign.NAMES
    assert table.numbers == (1, 2, 3, 4)
    np.testing.assert_array_equal(table.relative_rms_error, campaign.errors)
    np.testing.assert_array_equal(table.rms_response, campaign.rms_responses)
    np.testing.assert_array_equal(table.peak_ratio, campaign.peak_ratios)
    np.testing.assert_allclose(table.damage_ratio, campaign.rms_responses[:, :, None] ** np.array([3.0, 5.0, 8.0]))
    np.testing.assert_allclose(table.overall, np.sqrt(np.mean(campaign.errors**2, axis=1)))


def test_the_folder_of_a_campaign_stands_for_its_recording(recording_path, tmp_path):
    (tmp_path / "recording.mcap").hardlink_to(recording_path)
    assert open_recording(tmp_path).path == tmp_path / "recording.mcap"
    (tmp_path / "recording.mcap").unlink()
    with pytest.raises(InputError, match="is a folder; give the path of an"):
        open_recording(tmp_path)


def test_signals_of_a_playback_equal_those_that_were_written(recording_path, campaign):
    playback = open_recording(recording_path).playback(3)
    np.testing.assert_array_equal(playback.drive.samples, campaign.drives[2])
    np.testing.assert_array_equal(playback.response.samples, campaign.responses[2])
    np.testing.assert_array_equal(playback.response_in_band.samples, synthetic_campaign.in_band(campaign.responses[2]))
    assert playback.run == "demo.i03"
    assert playback.actuators[5].largest_following_error == pytest.approx(6e-4)


def test_labelled_arrays_carry_names_and_units(recording_path, campaign):
    recording = open_recording(recording_path)
    array = recording.target.to_xarray("target")
    np.testing.assert_array_equal(array.sel(channel="right_lateral"), campaign.target[4])
    assert float(array.time[1000]) == 1.0
    assert set(array.unit.values) == {"N"}
    model = recording.model.to_xarray()
    assert model.frf.dims == ("frequency", "response", "drive")
    expected = from_array(campaign.model.frf)[100, 2, 5]
    assert (
        complex(model.frf.isel(frequency=100).sel(response="left_longitudinal", drive="right_longitudinal")) == expected
    )


def test_blocks_of_a_run_are_put_together_again(tmp_path, campaign):
    drive, response = campaign.drives[0][:, :950], campaign.responses[0][:, :950]
    blocks = synthetic_campaign.signal_blocks(drive, response, run="demo.i01")
    path = synthetic_campaign.write(tmp_path / "r.mcap", [*synthetic_campaign.steps(campaign), *blocks])
    played, measured = open_recording(path).signal("demo.i01")
    np.testing.assert_array_equal(played.samples, drive)
    np.testing.assert_array_equal(measured.samples, response)


def test_missing_block_is_reported_not_closed_up(tmp_path, campaign):
    blocks = synthetic_campaign.signal_blocks(campaign.drives[0], campaign.responses[0], run="demo.i01")
    path = synthetic_campaign.write(
        tmp_path / "r.mcap", [*synthetic_campaign.steps(campaign), *blocks[:3], *blocks[4:]]
    )
    with pytest.raises(InputError, match=r"lacks the samples 300 to 399 of the run 'demo.i01'"):
        open_recording(path).signal("demo.i01")


@pytest.mark.parametrize("finish", [True, False])
def test_a_block_that_came_late_is_put_where_it_belongs(tmp_path, campaign, finish):
    blocks = synthetic_campaign.signal_blocks(campaign.drives[0], campaign.responses[0], run="demo.i01")
    late = [*synthetic_campaign.steps(campaign), *blocks[:3], *blocks[4:], blocks[3]]
    recording = open_recording(synthetic_campaign.write(tmp_path / "r.mcap", late, finish=finish))
    played, measured = recording.signal("demo.i01")
    np.testing.assert_array_equal(played.samples, campaign.drives[0])
    np.testing.assert_array_equal(measured.samples, campaign.responses[0])


def before_playbacks(campaign):
    """Return the steps of a campaign that tell of no playback that it reached its end."""
    return [step for step in synthetic_campaign.steps(campaign) if not isinstance(step, recorder_pb2.RunPlayed)]


def repeated(path, campaign, epochs, *, played, finish):
    """Write a recording whose first playback was broken off after five blocks in one epoch and repeated in the other.

    The epochs are in the order in which they were written; played to its end was the one told, or none.
    """
    first, second = (
        synthetic_campaign.signal_blocks(campaign.drives[i], campaign.responses[i], run="demo.i01") for i in (0, 1)
    )
    told = [recorder_pb2.RunPlayed(run="demo.i01", rig="front_axle", epoch=played, blocks=120)] if played else []
    blocks = dict(zip(epochs, (first[:5], second), strict=True))
    if played == epochs[0]:
        blocks = dict(zip(epochs, (second, first[:5]), strict=True))
    return open_recording(
        synthetic_campaign.write(path, [*before_playbacks(campaign), *told], finish=finish, epochs=blocks)
    )


@pytest.mark.parametrize("finish", [True, False])
@pytest.mark.parametrize(("epochs", "played"), [((7, 9), 0), ((9, 7), 0), ((7, 9), 9), ((9, 7), 7), ((7, 9), 7)])
def test_of_a_repeated_run_the_epoch_counts_that_was_played_to_its_end_or_was_written_last(
    tmp_path, campaign, epochs, played, finish
):
    """Whichever number is larger: epochs come from a clock, which may have been set back."""
    recording = repeated(tmp_path / "r.mcap", campaign, epochs, played=played, finish=finish)
    _, measured = recording.signal("demo.i01")
    np.testing.assert_array_equal(measured.samples, campaign.responses[1])
    if finish:
        np.testing.assert_array_equal(recording.responses("demo.i01").to_array().values, campaign.responses[1])


@pytest.mark.parametrize("finish", [True, False])
@pytest.mark.parametrize("there", [1, 5, 119])
def test_a_run_that_was_broken_off_is_not_taken_for_a_whole_one(tmp_path, campaign, there, finish):
    drive, response = campaign.drives[0], campaign.responses[0]
    blocks = synthetic_campaign.signal_blocks(drive, response, run="demo.i01")
    messages = [*synthetic_campaign.steps(campaign), *blocks[:there]]
    recording = open_recording(synthetic_campaign.write(tmp_path / "r.mcap", messages, finish=finish))
    reached = rf"up to sample {100 * there - 1} \({there / 10:g} s\) only and not its last block; "
    how = "read the others with `responses" if finish else "start the recorder on its folder, which repairs it, then"
    with pytest.raises(InputError, match=reached + how):
        recording.signal("demo.i01")
    if finish:
        np.testing.assert_array_equal(
            recording.responses("demo.i01").to_array().values, response[:, : 100 * there], strict=True
        )


def test_the_end_of_a_repetition_that_was_broken_off_is_not_that_of_the_one_before(tmp_path, campaign):
    blocks = synthetic_campaign.signal_blocks(campaign.drives[0], campaign.responses[0], run="demo.i01")
    path = synthetic_campaign.write(tmp_path / "r.mcap", before_playbacks(campaign), epochs={7: blocks, 9: blocks[:5]})
    with pytest.raises(InputError, match="up to sample 499"):
        open_recording(path).signal("demo.i01")


def test_blocks_that_overlap_are_reported(tmp_path, campaign):
    drive, response = campaign.drives[0], campaign.responses[0]
    blocks = [
        *synthetic_campaign.signal_blocks(drive[:, :200], response[:, :200], run="demo.i01"),
        *synthetic_campaign.signal_blocks(drive[:, :100], response[:, :100], run="demo.i01"),
    ]
    blocks[-1].first_sample = 150
    path = synthetic_campaign.write(tmp_path / "r.mcap", [*synthetic_campaign.steps(campaign), *blocks])
    with pytest.raises(InputError, match=r"holds the samples 150 to 199 of the run 'demo.i01' twice"):
        open_recording(path).signal("demo.i01")


def test_unknown_playback_and_run_name_what_there_is(recording_path):
    recording = open_recording(recording_path)
    with pytest.raises(InputError, match=r"no playback 9; it holds 1, 2, 3, 4"):
        recording.playback(9)
    with pytest.raises(InputError, match=r"no signals of a run 'x'; it holds none\."):
        recording.signal("x")


@pytest.mark.parametrize("finish", [True, False])
def test_an_unknown_run_names_those_whose_signals_are_there(tmp_path, campaign, finish):
    """Not one that was planned and of which no block is in what is left of the file."""
    blocks = synthetic_campaign.signal_blocks(campaign.drives[0], campaign.responses[0], run="demo.i01")
    messages = [*synthetic_campaign.steps(campaign), *blocks]
    recording = open_recording(synthetic_campaign.write(tmp_path / "r.mcap", messages, finish=finish))
    with pytest.raises(InputError, match=r"no signals of a run 'demo.i02'; it holds demo.i01\.$"):
        recording.signal("demo.i02")


def test_recording_of_a_killed_writer_is_read_up_to_its_end(tmp_path, campaign):
    messages = synthetic_campaign.steps(campaign)
    whole = synthetic_campaign.write(tmp_path / "whole.mcap", messages[:-2], finish=False, chunk_size=10_000)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-200_000])
    recording = open_recording(cut)
    assert not recording.whole
    assert recording.status is None
    assert 1 <= len(recording.iterations) < 4
    np.testing.assert_array_equal(recording.iterations.relative_rms_error[0], campaign.errors[0])


def everything_in(path):
    recording = open_recording(path)
    playbacks = [recording.playback(number) for number in recording.iterations.numbers]
    signals = [s.samples for p in playbacks for s in (p.drive, p.response, p.response_in_band)]
    return [recording.iterations.relative_rms_error, recording.target.samples, recording.model.frf, *signals]


def test_damaged_recording_is_refused_or_harmless_wherever_the_damage_is(tmp_path):
    made = synthetic_campaign.make(seconds=4.0, iterations=2)
    whole = synthetic_campaign.write(tmp_path / "whole.mcap", synthetic_campaign.steps(made))
    expected, content = everything_in(whole), whole.read_bytes()
    refused = 0
    for position in np.linspace(8, len(content) - 9, 60).astype(int):
        damaged = bytearray(content)
        damaged[position] ^= 0xFF
        path = tmp_path / "damaged.mcap"
        path.write_bytes(damaged)
        try:
            found = everything_in(path)
        except InputError:
            refused += 1
            continue
        # Not every byte matters: times and indexes of messages do not.
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one, other)
    assert refused > 40


@pytest.mark.parametrize("content", [b"", b"hello, this is no recording at all", b"\x89MCAP"])
def test_what_is_no_recording_is_refused(tmp_path, content):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"is no recording|holds no campaign"):
        _ = open_recording(path).specification


def test_missing_recording_is_refused(tmp_path):
    with pytest.raises(InputError, match="There is no recording"):
        open_recording(tmp_path / "none.mcap")


def test_messages_are_read_one_at_a_time(recording_path):
    steps = open_recording(recording_path).messages(iterator_pb2.IterationStep)
    assert next(steps).iteration == 1
    assert next(steps).iteration == 2
    steps.close()


def test_a_recording_in_several_files_reads_as_one(tmp_path):
    made = synthetic_campaign.make(seconds=4.0, iterations=3)
    steps = synthetic_campaign.steps(made)
    one = open_recording(synthetic_campaign.write(tmp_path / "one.mcap", steps))
    for number, part in enumerate((steps[:3], steps[3:6], steps[6:]), start=1):
        name = "several.mcap" if number == 1 else f"several.part{number:02d}.mcap"
        synthetic_campaign.write(tmp_path / name, part)
    several = open_recording(tmp_path / "several.mcap")
    assert several.whole
    assert several.iterations.numbers == one.iterations.numbers
    np.testing.assert_array_equal(several.playback(3).response.samples, one.playback(3).response.samples)
    assert several.closed == one.closed
    joined = b"".join(path.read_bytes() for path in several.files)
    assert len(several.files) == 3
    assert several.sha256 == hashlib.sha256(joined).hexdigest()
