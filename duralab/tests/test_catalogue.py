"""The recordings of a lab as a script and the command line see them."""

from __future__ import annotations

import json
import re
from contextlib import contextmanager
from datetime import UTC, date, datetime

import numpy as np
import pytest
from typer.testing import CliRunner

from duralab.cli.application import app
from duralab.errors import InputError
from duralab.lab import Catalogue, Result
from duralab.lab.client import LabClient
from duralab_proto.arrays import to_record
from duralab_proto.keys import Keys
from duralab_proto.v1 import array_pb2, iterator_pb2, recorder_pb2

DAY = datetime(2026, 5, 4, 12, 0, tzinfo=UTC)


def information(id, *, hours, **values):
    begun = int(DAY.timestamp() + 3600 * hours) * 10**9
    files = [recorder_pb2.RecordingFile(file=f"{id}.mcap", bytes=3 * 2**20)]
    settings = {"rig": "front_axle", "target": "road", "closed": True, "ended": True} | values
    return recorder_pb2.RecordingInfo(recording=id, begun=begun, files=files, bytes=3 * 2**20, **settings)


class Ask:
    """Stands for a lab: answers what it is given, and keeps what it was asked."""

    def __init__(self, *answers):
        self.bus = self
        self.keys = Keys()
        self.member = None
        self.asked = []
        self._answers = {type(answer): answer for answer in answers}

    def key(self, what, make, name):
        del what
        return make(name)

    def query(self, key, request, kind):
        self.asked.append((key, request))
        return self._answers[kind]


@pytest.fixture
def ask():
    return Ask(
        recorder_pb2.RecordingList(
            recordings=[
                information(
                    "late", hours=2, phase=iterator_pb2.CAMPAIGN_PHASE_FINISHED, outcome=iterator_pb2.OUTCOME_REACHED
                ),
                information("early", hours=0, phase=iterator_pb2.CAMPAIGN_PHASE_STOPPED),
                information("waiting", hours=1, closed=False, ended=False, waiting="No space left on device"),
            ]
        ),
        recorder_pb2.VerifyResult(recording="late", whole=False, findings=["A step is missing."]),
    )


def test_recordings_come_in_the_order_they_were_begun_with_how_they_ended(ask):
    entries = Catalogue(ask).search()
    assert [entry.id for entry in entries] == ["early", "waiting", "late"]
    assert [entry.result for entry in entries] == [Result.STOPPED, Result.NOT_ENDED, Result.REACHED]
    assert entries[0].begun == DAY


def test_a_search_is_asked_of_the_recorder_and_its_result_chosen_here(ask):
    found = Catalogue(ask).search(rig="front_axle", target="ROAD", begun_from=DAY, result=Result.REACHED)
    assert [entry.id for entry in found] == ["late"]
    _, request = ask.asked[0]
    assert (request.rig, request.target, request.begun_before) == ("front_axle", "ROAD", 0)
    assert request.begun_from == int(DAY.timestamp()) * 10**9


def test_a_search_by_the_moment_of_an_entry_finds_it_from_then_on_and_not_before_then():
    moments = np.random.default_rng(1).integers(1_500_000_000 * 10**9, 1_800_000_000 * 10**9, 500)
    recordings = [recorder_pb2.RecordingInfo(recording=f"r{moment}", begun=moment) for moment in moments.tolist()]
    ask = Ask(recorder_pb2.RecordingList())
    for entry in Catalogue(Ask(recorder_pb2.RecordingList(recordings=recordings))).search():
        Catalogue(ask).search(begun_from=entry.begun, begun_before=entry.begun)
        _, request = ask.asked[-1]
        # What the contract says: begun then or later, and before then, in nanoseconds; no more than a microsecond off.
        begun = int(entry.id[1:])
        assert request.begun_from <= begun < request.begun_from + 1000
        assert not begun < request.begun_before


@pytest.mark.parametrize("result", list(Result))
def test_a_result_may_be_given_in_its_words(ask, result):
    assert Catalogue(ask).search(result=str(result)) == Catalogue(ask).search(result=result)
    assert {entry.result for entry in Catalogue(ask).search(result=str(result))} <= {result}


def test_a_result_that_is_found_is_found_by_its_words(ask):
    assert [entry.id for entry in Catalogue(ask).search(result="reached")] == ["late"]


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (date(2026, 5, 4), datetime(2026, 5, 4)),
        ("2026-05-04", datetime(2026, 5, 4)),
        ("2026-05-04 12:30", datetime(2026, 5, 4, 12, 30)),
        ("2026-05-04T14:00:00+02:00", DAY),
    ],
)
def test_a_day_and_a_text_are_moments(ask, given, meant):
    Catalogue(ask).search(begun_from=given, begun_before=given)
    _, request = ask.asked[0]
    assert request.begun_from == request.begun_before == int(meant.timestamp()) * 10**9


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("result", "nonsense", "give one of reached, iterations used, "),
        ("result", 3, "give one of reached, "),
        ("begun_from", "yesterday", "a text like 2026-05-04T12:00"),
        ("begun_before", 2026, "give a datetime, a date or a text"),
        ("rig", 3, "give a text"),
        ("rig", None, "give a text"),
        ("target", ["road"], "give a text"),
    ],
)
def test_a_value_that_cannot_be_searched_for_is_refused_before_anybody_is_asked(ask, field, value, allowed):
    with pytest.raises(InputError) as caught:
        Catalogue(ask).search(**{field: value})
    assert str(caught.value).startswith(f"{field} is {value!r}; ")
    assert allowed in str(caught.value)
    assert caught.value.field == field
    assert ask.asked == []


@pytest.mark.parametrize("field", ["begun_from", "begun_before"])
@pytest.mark.parametrize(
    "moment", [datetime(1969, 12, 31, 23, 59, tzinfo=UTC), datetime(1970, 1, 1, tzinfo=UTC), datetime.min, datetime.max]
)
def test_a_moment_that_the_contract_cannot_hold_is_refused_before_anybody_is_asked(ask, field, moment):
    with pytest.raises(InputError, match=f"{field} is {moment.isoformat()[:10]}.*; it must be after") as caught:
        Catalogue(ask).search(**{field: moment})
    assert caught.value.field == field
    assert ask.asked == []


def test_a_window_of_signals_is_decoded():
    channel = array_pb2.Channel(name="left", unit="N", minimum=-1.0, maximum=1.0)
    record = to_record([channel], 100.0, np.arange(5.0)[None])
    ask = Ask(recorder_pb2.SignalWindow(run="demo.i01", drive=record, response=record))
    _, response = Catalogue(ask).signals("demo", "demo.i01", first_second=1.0, seconds=0.05, channels=["left"])
    np.testing.assert_array_equal(response.samples, np.arange(5.0)[None])
    key, request = ask.asked[0]
    assert key == Keys().recording_signals("demo")
    assert (request.first_second, request.seconds, list(request.channels)) == (1.0, 0.05, ["left"])


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("run", None, "give a text."),
        ("first_second", "x", "give a number of seconds."),
        ("seconds", [1.0], "give a number of seconds."),
        ("seconds", True, "give a number of seconds."),
        ("channels", "left_vertical", "give a sequence of names, e.g. ['left_vertical'], or leave it out."),
        ("channels", ["left", 3], "give a sequence of names"),
        ("channels", 3, "give a sequence of names"),
    ],
)
def test_a_window_that_cannot_be_asked_for_is_refused_before_anybody_is_asked(ask, field, value, allowed):
    wanted = {"run": "demo.i01", "first_second": 1.0, "seconds": 0.05} | {field: value}
    with pytest.raises(InputError) as caught:
        Catalogue(ask).signals("demo", **wanted)
    assert str(caught.value).startswith(f"{field} is {value!r}; {allowed}")
    assert caught.value.field == field
    assert ask.asked == []


@pytest.mark.parametrize("id", [5, None, b"demo"])
def test_an_id_that_is_no_text_is_refused(id):
    class Named:
        keys = Keys()

    with pytest.raises(InputError, match=f"^id is {id!r}; give its name as a text\\.$") as caught:
        Catalogue(LabClient(Named(), lambda: None)).verify(id)
    assert caught.value.field == "id"


@pytest.fixture
def command(ask, monkeypatch):
    class Lab:
        catalogue = Catalogue(ask)

    @contextmanager
    def connect(endpoint):
        assert endpoint == "tcp/127.0.0.1:9"
        yield Lab()

    monkeypatch.setattr("duralab.lab.connect", connect)
    there = ["--connect", "tcp/127.0.0.1:9"]
    return lambda *arguments: CliRunner().invoke(app, [*arguments, *there], env={"COLUMNS": "200"})


def test_the_command_prints_a_table_or_json(command):
    shown = command("catalogue").stdout
    assert shown.index("early") < shown.index("late")
    assert "waits: No space left on device" in shown
    document = json.loads(command("catalogue", "--json", "--result", "reached").stdout)
    assert [(entry["id"], entry["begun"]) for entry in document] == [("late", "2026-05-04T14:00:00+00:00")]


ROAD = "ISO 8608 road of class C/D with 4 potholes (seed 8608), 20 s driven at 15 m/s"
SHOWN = (
    information(
        "front_axle_demo",
        hours=0,
        outcome=iterator_pb2.OUTCOME_ITERATIONS_USED,
        target=ROAD,
        steps=123,
        signal_blocks=123456,
        missing_blocks=17,
    ),
    information("another_one_with_a_[bold]_name_01", hours=1, steps=2345, signal_blocks=98765, missing_blocks=4321),
    information("waiting", hours=2, closed=False, ended=False, waiting="No space left on device"),
)


@pytest.fixture
def shown(monkeypatch):
    @contextmanager
    def connect(endpoint):
        del endpoint
        yield type("Lab", (), {"catalogue": Catalogue(Ask(recorder_pb2.RecordingList(recordings=SHOWN)))})

    monkeypatch.setattr("duralab.lab.connect", connect)

    def show(columns, **environment):
        settings = {"COLUMNS": str(columns), "NO_COLOR": "1", **environment}
        text = CliRunner().invoke(app, ["catalogue", "--connect", "tcp/127.0.0.1:9"], env=settings).stdout
        return re.sub(r"\x1b\[[0-9;]*m", "", text)

    return show


@pytest.mark.parametrize("columns", [20, 60, 80, 100, 120, 160, 250])
@pytest.mark.parametrize("environment", [{}, {"TTY_COMPATIBLE": "1"}])
def test_ids_and_numbers_are_whole_however_narrow_the_terminal(shown, columns, environment):
    lines = shown(columns, **environment).splitlines()
    for entry in SHOWN:
        line = next(line for line in lines if line.startswith(f"{entry.recording} "))
        numbers = [str(entry.steps), str(entry.signal_blocks), str(entry.missing_blocks), "3.0"]
        assert line.split()[-4:] == numbers
        assert entry.rig in line


@pytest.mark.parametrize("columns", [20, 80])
def test_what_goes_into_a_pipe_is_not_cut_at_all(shown, columns):
    text = shown(columns)
    assert "…" not in text
    assert all(entry.target in text for entry in SHOWN)
    assert "waits: No space left on device" in text


def test_in_a_terminal_the_target_gives_way_first_and_it_is_said(shown):
    for columns, whole in ((250, True), (150, False)):
        text = shown(columns, TTY_COMPATIBLE="1")
        assert (ROAD in text) is whole
        assert ROAD[:12] in text
        assert "waits: No space left on device" in text
        assert max(map(len, text.splitlines())) <= columns
    text = shown(80, TTY_COMPATIBLE="1")
    assert "ISO" not in text
    assert "The targets are left out, for which 80 columns are too few; --json contains them." in text


def test_a_damaged_recording_ends_the_command_with_its_findings_and_a_code(command):
    done = command("verify", "late")
    assert done.exit_code == 1
    assert "A step is missing." in done.stdout
    assert json.loads(command("verify", "late", "--json").stdout)["whole"] is False


def said(done):
    return " ".join(done.stderr.split())


def test_a_recording_that_is_not_there_is_refused_in_the_words_of_the_command_line(command, ask, monkeypatch):
    answer = ask.query

    def query(key, request, kind):
        if kind is recorder_pb2.VerifyResult:
            sentence = "There is no file nope.mcap; recorder/recording/list names the recordings."
            raise InputError(sentence, field="recording", service="recorder")
        return answer(key, request, kind)

    monkeypatch.setattr(ask, "query", query)
    done = command("verify", "nope")
    assert done.exit_code == 2
    assert said(done) == (
        "Error: There is no recording 'nope'; `duralab catalogue` lists those there are, and the path of a "
        "recording.mcap has its files verified."
    )
    # What is wrong with one that is there is said as it is.
    assert "There is no file" in said(command("verify", "late"))


@pytest.mark.parametrize("option", ["--from", "--before"])
def test_a_time_is_refused_by_the_name_of_its_option(command, option):
    done = command("catalogue", option, "1900-01-01")
    assert done.exit_code == 2
    assert said(done).startswith(f"Error: {option} is 1900-01-01T00:00:00; it must be after the beginning of 1970")


def test_a_result_that_is_none_is_refused_without_words_of_python(command):
    done = command("catalogue", "--result", "foo")
    assert done.exit_code == 2
    assert "'--result': 'foo' is not one of 'reached', " in said(done)
