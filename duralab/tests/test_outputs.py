"""What a command writes never takes the place of what it reads, by whatever name, with --replace or without."""

import hashlib

import pytest
import synthetic_campaign
from test_cli import invoke

import duralab
from duralab.errors import InputError
from duralab.output_files import replace_when_complete


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    campaign = synthetic_campaign.make(seconds=4.0, iterations=2)
    folder = tmp_path_factory.mktemp("read")
    messages = synthetic_campaign.steps(campaign)
    synthetic_campaign.write(folder / "a.mcap", messages[:6])
    synthetic_campaign.write(folder / "a.part02.mcap", messages[6:])
    (folder / "linked.mcap").symlink_to(folder / "a.mcap")
    (folder / "hard.html").hardlink_to(folder / "a.mcap")
    return folder


def digests(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


@pytest.mark.parametrize("out", ["a.mcap", "a.part02.mcap", "linked.mcap", "hard.html", "../{name}/a.mcap"])
@pytest.mark.parametrize(
    "command",
    [
        ("export", "{read}", "{out}", "--format", "csv"),
        ("export", "{read}", "{out}", "--what", "target", "--format", "rpc3"),
        ("report", "{read}", "--out", "{out}"),
        ("report", "{read}", "--out", "{free}", "--pdf", "{out}"),
        ("compare", "{read}", "{read}", "--out", "{out}"),
        ("compare", "{read}", "{read}", "--out", "{free}", "--pdf", "{out}"),
    ],
)
def test_no_command_writes_over_the_recording_it_reads(made, tmp_path, command, out):
    before = digests(made)
    names = {"read": made / "a.mcap", "out": made / out.format(name=made.name), "free": tmp_path / "free.html"}
    code, _, error = invoke(*(part.format(**names) for part in command), "--replace")
    assert code == 2
    assert f"{names['out']} is the file that is read; give another one for the output." in " ".join(error.split())
    assert digests(made) == before
    assert not names["free"].exists()


def test_a_script_writes_no_report_over_its_recording(made):
    before = digests(made)
    for write in (
        duralab.write_report,
        lambda read, out: duralab.write_comparison(out, [read, read]),
        duralab.write_pdf,
        lambda read, out: duralab.write_pdf(duralab.compare(read, read), out),
    ):
        with pytest.raises(InputError, match=r"a\.part02\.mcap is the file that is read"):
            write(made / "a.mcap", made / "a.part02.mcap")
    assert digests(made) == before


def test_other_files_are_replaced_when_asked(made, tmp_path):
    out = tmp_path / "drive.csv"
    out.write_text("old")
    assert invoke("export", made / "a.mcap", out, "--replace")[0] == 0
    assert out.read_text() != "old"


def test_a_name_that_no_file_can_have_is_one_sentence(made):
    code, _, error = invoke("export", made / "a.mcap", f"{'a' * 300}.csv")
    assert code == 2
    assert "cannot be a file: File name too long; give another name." in " ".join(error.split())


def test_what_a_killed_process_left_is_not_in_the_way_of_one_with_its_id(tmp_path):
    path = tmp_path / "a.mcap"
    # It never comes to its end, and what is written next is written under the same process id, as in a container.
    killed = replace_when_complete(path)
    killed.__enter__().write_bytes(b"half")
    with replace_when_complete(path) as temporary, temporary.open("xb") as stream:
        stream.write(b"whole")
    assert path.read_bytes() == b"whole"


def test_two_that_write_one_file_at_a_time_do_not_write_into_each_other(tmp_path):
    path = tmp_path / "a.txt"
    # Two containers beside each other: both processes have the same id.
    with replace_when_complete(path) as first, replace_when_complete(path) as second:
        first.write_text("first")
        second.write_text("second")
        assert (first.read_text(), second.read_text()) == ("first", "second")
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]
