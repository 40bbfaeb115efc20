"""The recordings of a lab of one's own: deleted only when each was brought to its user."""

import pytest

import duralab
from duralab.cli.ending import ended_well
from duralab.errors import InputError
from duralab.lab import RecordingsPlace
from duralab.lab.recordings_folder import own_recordings


def recorded(place, *names):
    for name in names:
        (place.folder / name).write_bytes(b"what was played")


def test_nothing_is_left_where_every_recording_was_fetched(tmp_path):
    with own_recordings(tmp_path / "out") as place:
        recorded(place, "demo.mcap", "demo.part02.mcap", "demo.rrd", ".recorder")
        place.fetched.add("demo")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_copy_that_was_resumed_from_stays_only_if_the_campaign_went_on_in_it(tmp_path, recording_path):
    given = duralab.open(recording_path)
    before = recording_path.read_bytes(), recording_path.stat().st_mtime_ns
    for changes in (False, True):
        with own_recordings(tmp_path / str(changes)) as place:
            place.copy_in(given)
            assert (place.folder / "demo.mcap").read_bytes() == before[0]
            with pytest.raises(InputError, match="holds a recording 'demo' already"):
                place.copy_in(given)
            assert place.expect_change("demo")
            if not changes:
                place.copies.add("demo")
        assert place.folder.exists() is changes
    assert (recording_path.read_bytes(), recording_path.stat().st_mtime_ns) == before
    with pytest.raises(InputError, match="name 'demo' where the lab's catalogue lists it"):
        RecordingsPlace().copy_in(given)


def test_all_of_it_stays_where_one_was_not_fetched(tmp_path):
    with own_recordings(tmp_path / "out") as place:
        recorded(place, "demo.mcap", "demo-2.mcap", "demo-2.part02.mcap")
        place.fetched.add("demo")
    assert place.folder == tmp_path / "out" / "recordings"
    assert sorted(path.name for path in place.folder.iterdir()) == ["demo-2.mcap", "demo-2.part02.mcap", "demo.mcap"]


def test_what_an_earlier_lab_left_is_not_touched(tmp_path):
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "demo.mcap").touch()
    with own_recordings(tmp_path) as place:
        assert place.folder == tmp_path / "recordings-2"
    assert [str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")] == ["recordings", "recordings/demo.mcap"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, SystemExit])
def test_whatever_ends_the_lab_says_where_they_are_once(tmp_path, error):
    with pytest.raises(error) as caught, own_recordings(tmp_path) as place:  # noqa: PT012
        recorded(place, "demo.mcap", "other.mcap")
        already = place.say("demo", "What was played is in demo.mcap.")
        raise error(already)
    assert caught.value.__notes__ == [f"The recording 'other' is in {tmp_path / 'recordings' / 'other.mcap'}."]


def test_a_lab_without_a_place_leaves_nothing_but_what_was_not_fetched(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with own_recordings(None) as place:
        (place.passing / "demo").mkdir(parents=True)
        assert not place.outlives(place.passing / "demo" / "recording.mcap")
        assert place.outlives(tmp_path / "recording.mcap")
    assert list(tmp_path.iterdir()) == []
    with pytest.warns(UserWarning, match=r"The recording 'demo' is in .*recordings/demo\.mcap"):
        leave_one_behind()
    assert [path.name for path in tmp_path.rglob("*.mcap")] == ["demo.mcap"]


def leave_one_behind():
    with own_recordings(None) as place:
        recorded(place, "demo.mcap")


def test_a_folder_that_cannot_be_made_is_said(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be made"), own_recordings(tmp_path / "file" / "out"):
        pass


def test_an_interrupted_command_says_where_they_are(tmp_path, capsys):
    interrupt = KeyboardInterrupt()
    place = RecordingsPlace(tmp_path)
    recorded(place, "demo.mcap")
    place.add_notes(interrupt)
    with pytest.raises(BaseException, match="130"), ended_well():
        raise interrupt
    assert capsys.readouterr().err == (
        f"Interrupted; everything that was started is ended. The recording 'demo' is in {tmp_path / 'demo.mcap'}.\n"
    )
