"""The recordings of a lab as a script and the command line see them."""

from __future__ import annotations

import json
from contextlib import contextmanager
from datetime import UTC, datetime

import numpy as np
import pytest
from typer.testing import CliRunner

from duralab.catalogue import Catalogue
from duralab.cli import app
from duralab.errors import InputError
from duralab.recorded_result import Result
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


@pytest.fixture
def command(ask, monkeypatch):
    class Lab:
        catalogue = Catalogue(ask)

    @contextmanager
    def connect(endpoint):
        assert endpoint == "tcp/127.0.0.1:9"
        yield Lab()

    monkeypatch.setattr("duralab.cli.catalogue_command.connect", connect)
    there = ["--connect", "tcp/127.0.0.1:9"]
    return lambda *arguments: CliRunner().invoke(app, [*arguments, *there], env={"COLUMNS": "200"})


def test_the_command_prints_a_table_or_json(command):
    shown = command("catalogue").stdout
    assert shown.index("early") < shown.index("late")
    assert "waits: No space left on device" in shown
    document = json.loads(command("catalogue", "--json", "--result", "reached").stdout)
    assert [(entry["id"], entry["begun"]) for entry in document] == [("late", "2026-05-04T14:00:00+00:00")]


def test_a_damaged_recording_ends_the_command_with_its_findings_and_a_code(command):
    done = command("verify", "late")
    assert done.exit_code == 1
    assert "A step is missing." in done.stdout
    assert json.loads(command("verify", "late", "--json").stdout)["whole"] is False
