"""`duralab convert` and `duralab export`: files from one format into another, and out of a recording."""

import json

import numpy as np
import pytest
import synthetic_campaign
from test_cli import invoke

from duralab import Channel, Signals, open_recording
from duralab.formats import read_frequency_response, read_signals, write_signals
from duralab_proto.v1 import iterator_pb2


@pytest.fixture
def source(tmp_path):
    time = np.arange(4000) / 500
    rows = np.array([2.0 * np.sin(2 * np.pi * 5 * time), 10.0 * np.cos(2 * np.pi * 3 * time)])
    path = tmp_path / "road.rsp"
    write_signals(Signals((Channel("force", "kN"), Channel("travel", "mm")), 500.0, rows), path)
    return path


def test_a_response_file_becomes_a_table_in_si_units(tmp_path, source):
    code, out, _ = invoke("convert", source, tmp_path / "road.csv", "--unit", "SI")
    assert code == 0
    assert "2 channels, 4000 samples at 500 Hz" in out
    signals = read_signals(tmp_path / "road.csv")
    assert [channel.unit for channel in signals.channels] == ["N", "m"]
    assert np.abs(signals.samples).max(axis=1) == pytest.approx([2000.0, 0.01], rel=1e-3)


def test_a_rate_and_a_unit_for_one_channel_and_the_format_can_be_asked_for(tmp_path, source):
    out = tmp_path / "road.data"
    code, text, _ = invoke("convert", source, out, "--format", "mat", "--rate", 1000, "--unit", "force=N", "--json")
    assert code == 0
    told = json.loads(text)
    assert (told["format"], told["sample_rate"], told["channels"][0]["unit"]) == ("mat", 1000.0, "N")
    signals = read_signals(out, format="mat")
    assert signals.sample_rate == 1000.0
    time = signals.time[1000:7000]
    np.testing.assert_allclose(signals.samples[0, 1000:7000], 2000 * np.sin(2 * np.pi * 5 * time), atol=2.0)
    assert signals.channels[1].unit == "mm"


def test_the_quantisation_of_a_drive_is_told_in_its_unit(tmp_path, source):
    code, out, _ = invoke("convert", source, tmp_path / "road.drv", "--unit", "N", "--unit", "m")
    assert code == 0
    assert "zeros pad the last group" in out
    # The source holds integers of the same full scale, so that hardly anything is lost again.
    code, out, _ = invoke("convert", source, tmp_path / "b.rsp", "--rate", 750)
    assert "force: 3" in out
    assert "e-05 kN (1.5e-05 of its peak)" in out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("none.rsp", "a.csv"), "there is no such file"),
        (("{source}", "{source}"), "is the file that is read"),
        (("{source}", "there.csv"), "overwritten"),
        (("{source}", "a.wav"), "suffix '.wav'"),
        (("{source}", "a.csv", "--format", "wav"), "'wav'"),
        (("{source}", "a.csv", "--unit", "N"), "none of N"),
        (("{source}", "a.csv", "--unit", "speed=N"), "no channel speed"),
        (("{source}", "a.csv", "--unit", "N", "--unit", "m", "--unit", "lbf"), "force can be in N or lbf; "),
        (("{source}", "a.csv", "--unit", "force=kN", "--unit", "force=N"), "--unit gives force two units, kN and N; "),
        (("{source}", "a.csv", "--rate", "-5"), "rate"),
        (("{source}", "a.csv", "--data-type", "short_integer"), "only rpc3"),
    ],
)
def test_a_mistake_is_one_sentence_and_nothing_is_written(tmp_path, source, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.csv").write_text("mine")
    before = sorted(path.name for path in tmp_path.iterdir())
    code, _, error = invoke("convert", *(argument.format(source=source) for argument in arguments))
    assert code == 2
    assert said in error
    assert "Traceback" not in error
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert (tmp_path / "there.csv").read_text() == "mine"


def test_drive_response_target_and_frequency_responses_come_out_of_a_recording(tmp_path, recording_path):
    recording = open_recording(recording_path)
    best = recording.playback(recording.status.best_iteration)
    assert best.number != recording.iterations.numbers[-1]
    first = recording.playback(1)
    for what, playback, expected in (
        ("drive", None, best.drive),
        ("response", 1, first.response),
        ("response_in_band", None, best.response_in_band),
        ("target", None, Signals.from_message(recording.specification.target, field="target")),
        ("target_in_band", None, recording.target),
    ):
        out = tmp_path / f"{what}.csv"
        options = () if playback is None else ("--playback", playback)
        assert invoke("export", recording_path, out, "--what", what, *options)[0] == 0
        signals = read_signals(out)
        assert signals.names == expected.names
        np.testing.assert_array_equal(signals.samples, expected.samples)
    assert invoke("export", recording_path, tmp_path / "last.drv")[0] == 0
    assert read_signals(tmp_path / "last.drv").attributes["TIME_TYPE"] == "DRIVE"
    assert invoke("export", recording_path, tmp_path / "last.tim")[0] == 0
    assert read_signals(tmp_path / "last.tim").attributes["TIME_TYPE"] == "DRIVE"
    assert invoke("export", recording_path, tmp_path / "h.uff", "--what", "frf")[0] == 0
    response = read_frequency_response(tmp_path / "h.uff")
    known = np.isfinite(recording.model.frf).all(axis=(1, 2))
    np.testing.assert_array_equal(response.frf, recording.model.frf[known])
    np.testing.assert_allclose(response.frequency, recording.model.frequency[known], rtol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("a.csv", "--what", "road"), "target, target_in_band, drive"),
        (("a.csv", "--what", "frf"), ".uff"),
        (("a.csv", "--what", "target", "--playback", "1"), "leave it out"),
        (("h.uff", "--what", "frf", "--playback", "2"), "--playback is 2; the frequency responses are the model's"),
        (("h.uff", "--what", "frf", "--unit", "SI"), "--unit is SI; "),
        (("h.uff", "--what", "frf", "--format", "csv"), "--format is csv; "),
        (("h.uff", "--what", "frf", "--data-type", "int16"), "--data-type is int16; "),
        (("a.csv", "--playback", "99"), "no playback 99"),
        (("a.csv", "--unit", "left_vertical=mm", "--unit", "left_vertical=m"), "left_vertical two units, mm and m; "),
    ],
)
def test_what_a_recording_does_not_hold_is_said(tmp_path, recording_path, arguments, said):
    code, _, error = invoke("export", recording_path, tmp_path / arguments[0], *arguments[1:])
    assert code == 2
    assert said in error


def exported(tmp_path, recording, *arguments):
    """Return what an export says in words, and as JSON."""
    code, words, error = invoke("export", recording, tmp_path / "a.csv", "--replace", *arguments)
    assert code == 0, error
    code, told, error = invoke("export", recording, tmp_path / "a.csv", "--replace", "--json", *arguments)
    assert code == 0, error
    return words, json.loads(told)


def test_an_export_says_which_playback_it_wrote_and_how_good_it_was(tmp_path, recording_path, campaign):
    table = open_recording(recording_path).iterations
    for number in table.numbers:
        words, told = exported(tmp_path, recording_path, "--playback", number)
        error = synthetic_campaign.metrics(campaign, number - 1).overall_relative_rms_error
        assert f"playback {number} of {len(table)} in the recording; " in words
        assert f"error over all channels is {error:.3f}." in words
        assert ("The best is playback" in words) == (number != table.numbers[table.best])
        assert (told["playback"], told["overall_error"]) == (number, pytest.approx(error))
    words, told = exported(tmp_path, recording_path)
    assert told["playback"] == told["best_playback"] == open_recording(recording_path).status.best_iteration
    assert "It is the best playback." in words
    words, told = exported(tmp_path, recording_path, "--what", "target")
    assert (told["playback"], told["overall_error"]) == (None, None)
    assert "playback" not in words
    assert told["recording_finished"] is True
    assert "never finished" not in words
    assert "ended early" not in words


def test_an_export_of_a_recording_that_was_cut_off_says_so(tmp_path, recording_path, campaign):
    cut = tmp_path / "cut.mcap"
    steps = synthetic_campaign.steps(campaign)
    first = next(i for i, step in enumerate(steps) if isinstance(step, iterator_pb2.IterationStep))
    synthetic_campaign.write(cut, steps[: first + 1])
    words, told = exported(tmp_path, cut)
    assert "It is playback 1 of 1 in the recording" in words
    assert "The campaign ended early, 1 playback done" in words
    assert told["judgement"] == "ended early"
    content = recording_path.read_bytes()
    cut.write_bytes(content[: len(content) * 9 // 10])
    words, told = exported(tmp_path, cut)
    assert f"{cut} was never finished" in words
    assert told["recording_finished"] is False
    words, told = exported(tmp_path, cut, "--what", "target")
    assert f"{cut} was never finished" in words
