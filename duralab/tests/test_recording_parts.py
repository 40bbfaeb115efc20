"""A recording in several files is read as one where they are its parts in order, and refused where they are not."""

import re
import shutil

import pytest
import synthetic_campaign

import duralab
from duralab.errors import InputError
from duralab.report import write_report
from duralab_proto.v1 import iterator_pb2

PARTS = 4


def steps(*numbers):
    return [iterator_pb2.IterationStep(iteration=number, run=f"demo.i{number:02d}") for number in numbers]


def name(number, stem="r"):
    return f"{stem}.mcap" if number == 1 else f"{stem}.part{number:02d}.mcap"


def write_part(folder, number, *, recording="demo", parts=PARTS, stem="r", finish=True):
    return synthetic_campaign.write(
        folder / name(number, stem),
        steps(2 * number - 1, 2 * number),
        part=(recording, number),
        # A recorder names the files by the recording's id; who copies them may name them otherwise.
        next_file=name(number + 1, recording) if number < parts else "",
        finish=finish,
    )


@pytest.fixture
def folder(tmp_path):
    for number in range(1, PARTS + 1):
        write_part(tmp_path, number)
    return tmp_path


def numbers_in(folder):
    return [step.iteration for step in duralab.open(folder / "r.mcap").messages(iterator_pb2.IterationStep)]


def refused(path, *said):
    with pytest.raises(InputError) as caught:
        duralab.open(path)
    assert all(part in str(caught.value) for part in said), caught.value
    assert len(re.findall(r"\.(?= |$)", str(caught.value))) == 1


def test_a_whole_chain_is_one_recording(folder):
    assert numbers_in(folder) == [1, 2, 3, 4, 5, 6, 7, 8]
    assert [file.name for file in duralab.open(folder / "r.mcap").files] == [name(n) for n in range(1, PARTS + 1)]


@pytest.mark.parametrize("missing", [2, 3])
def test_a_part_missing_in_the_middle_is_named(folder, missing):
    (folder / name(missing)).unlink()
    refused(folder / "r.mcap", f"{folder / name(missing)} is missing", f"{name(missing + 1)} is there")


def test_a_hole_is_found_where_no_file_names_the_next(tmp_path):
    """A recorder that goes on with a closed recording leaves the end of the file before as it is."""
    for number in (1, 3):
        write_part(tmp_path, number, parts=number)
    refused(tmp_path / "r.mcap", f"{tmp_path / name(2)} is missing")


@pytest.mark.parametrize("last", [1, 2, 3])
def test_the_last_parts_missing_are_found(folder, last):
    for number in range(last + 1, PARTS + 1):
        (folder / name(number)).unlink()
    refused(folder / "r.mcap", f"continues in {name(last + 1)}, which is missing")


@pytest.mark.parametrize(("one", "other"), [(1, 2), (2, 3), (3, 4)])
def test_parts_that_changed_names_are_found(folder, one, other):
    (folder / name(one)).rename(folder / "aside")
    (folder / name(other)).rename(folder / name(one))
    (folder / "aside").rename(folder / name(other))
    refused(folder / "r.mcap", f"{name(one)} is part {other} of the recording 'demo', where part {one} belongs")


@pytest.mark.parametrize("foreign", [1, 2, 4])
def test_a_part_of_another_recording_is_found(folder, foreign):
    write_part(folder, foreign, recording="other")
    refused(folder / "r.mcap", "other", "demo", "belongs; put that one in its place")


def test_a_following_file_that_names_no_recording_is_found(folder):
    synthetic_campaign.write(folder / name(2), steps(3, 4))
    refused(folder / "r.mcap", f"{folder / name(2)} is of a recording that it does not name")


@pytest.mark.parametrize("number", [2, 3, 4])
def test_a_following_part_says_which_file_to_open(folder, number):
    first = folder / "r.mcap"
    refused(folder / name(number), f"is part {number} of the recording 'demo'; open its first file, {first}")


def test_the_last_part_may_have_been_broken_off(folder):
    write_part(folder, PARTS, finish=False)
    assert numbers_in(folder) == [1, 2, 3, 4, 5, 6, 7, 8]
    assert not duralab.open(folder / "r.mcap").whole
    write_part(folder, PARTS, recording="other", finish=False)
    refused(folder / "r.mcap", "is of the recording 'other'")


def test_a_last_part_that_its_recorder_only_began_is_not_missed(folder):
    synthetic_campaign.write(folder / name(PARTS), [], finish=False)
    assert numbers_in(folder) == [1, 2, 3, 4, 5, 6]
    assert not duralab.open(folder / "r.mcap").whole
    # One that holds something and does not say of what is none of this recording's.
    synthetic_campaign.write(folder / name(PARTS), steps(9), finish=False)
    refused(folder / "r.mcap", f"{folder / name(PARTS)} is of a recording that it does not name")


def test_files_that_are_no_parts_do_no_harm(tmp_path):
    write_part(tmp_path, 1, parts=1)
    for other in ("r.part2.mcap", "r.part002.mcap", "r.part03.mcap.md5", "rr.part03.mcap", "r.part01.mcap", "rXmcap"):
        (tmp_path / other).write_text("no part")
    (tmp_path / "r.part05.mcap").mkdir()
    assert numbers_in(tmp_path) == [1, 2]


def test_what_an_earlier_recorder_wrote_without_naming_its_parts_is_read(tmp_path):
    for number in (1, 2):
        synthetic_campaign.write(tmp_path / name(number), steps(number))
    assert numbers_in(tmp_path) == [1, 2]


def test_a_link_to_the_first_file_looks_for_parts_beside_itself(folder, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("linked")
    (elsewhere / "r.mcap").symlink_to(folder / "r.mcap")
    refused(elsewhere / "r.mcap", "continues in r.part02.mcap, which is missing")
    for number in range(2, PARTS + 1):
        shutil.copy(folder / name(number), elsewhere)
    assert numbers_in(elsewhere) == [1, 2, 3, 4, 5, 6, 7, 8]


def test_a_first_part_of_which_the_recorder_was_killed_says_that_the_recording_may_go_on(tmp_path, campaign):
    """Repaired, it names no next file: there was none yet."""
    path = tmp_path / "alone.mcap"
    steps = synthetic_campaign.steps(campaign)
    synthetic_campaign.write(path, steps[:8], part=("demo", 1), reason="Its recorder was killed.")
    recording = duralab.open(path)
    assert recording.whole
    said = (
        "its recorder was killed, and the recording may continue in alone.part02.mcap and further, which are not beside"
    )
    assert recording.open_end.startswith(said)
    assert said in str(recording)
    html = write_report(path, tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"The campaign ended early, 1 playback done: {said} alone.mcap." in html
    synthetic_campaign.write(tmp_path / "alone.part02.mcap", steps[8:], part=("demo", 2), reason="finished")
    recording = duralab.open(path)
    assert recording.open_end == ""
    assert "killed" not in str(recording)
    # A second kill, and so on.
    synthetic_campaign.write(tmp_path / "alone.part02.mcap", steps[8:-2], part=("demo", 2))
    assert "it was not closed, and the recording may continue in alone.part03" in duralab.open(path).open_end
