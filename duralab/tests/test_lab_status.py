"""How a lab is, from what its services answer, or do not answer."""

import math

import pytest
import synthetic_campaign
from test_catalogue import information

from duralab.cli.commands.status import _service_table
from duralab.cli.run_display import RunDisplay
from duralab.data import RigMode
from duralab.lab import LabStatus, ServiceHealth, lab_status
from duralab.lab.status import Figure
from duralab_bus import FaultError, FigureKind
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2, rig_pb2

ALL = {("rig_sim", "front_axle"), ("identifier", "main"), ("iterator", "main"), ("recorder", "main")}


class Bus:
    """A bus on which each key has its answer; anything else is not there."""

    keys = Keys()
    member = None

    def __init__(self, live, answers):
        self._live, self._answers = live, answers

    def discover(self):
        return self._live

    def query(self, key, request, kind, *, silence_seconds):
        del request, kind
        assert silence_seconds < 5.0
        if key not in self._answers:
            raise FaultError(query_pb2.FAULT_CODE_UNAVAILABLE, f"Nobody serves {key}.")
        return self._answers[key]


def recordings(*entries):
    return {Keys().recordings(): recorder_pb2.RecordingList(recordings=entries)}


def test_a_whole_lab_is_whole_and_tells_its_disk(tmp_path):
    state = rig_pb2.RigState(rig="front_axle", mode=rig_pb2.RIG_MODE_PLAYING, run="a.i01", fraction=0.5)
    found = lab_status(Bus(ALL, {Keys().rig_state("front_axle"): state, **recordings()}), recordings=tmp_path)
    assert found.whole
    assert (found.rigs[0].mode, found.rigs[0].run) == (RigMode.PLAYING, "a.i01")
    assert found.recorder.free_bytes > 0
    assert found.campaigns == ()


@pytest.mark.parametrize("service", ["rig_sim", "identifier", "iterator", "recorder"])
def test_a_service_that_is_gone_is_named(service):
    live = {(name, instance) for name, instance in ALL if name != service}
    found = lab_status(Bus(live, recordings()))
    assert found.missing == (service,)
    assert not found.whole
    assert (found.recorder is None) == (service == "recorder")


def test_of_a_rigs_figures_its_own_is_shown():
    figure = Figure("duralab_rig_real_time_factor", "", FigureKind.GAUGE, {"rig": "played"}, 120.0)
    waiting = Figure("duralab_queries_waiting", "", FigureKind.GAUGE, {}, 3.0)
    services = tuple(ServiceHealth("rig_sim", rig, figures=(figure, waiting)) for rig in ("idle", "played"))
    table = _service_table(LabStatus(missing=(), services=services, rigs=(), campaigns=(), recorder=None))
    shown = {column.header: list(column.cells) for column in table.columns}
    assert shown["× real time"] == ["", "120"]
    assert shown["waiting"] == ["3", "3"]


def test_a_rig_that_does_not_answer_hides_none_of_the_rest():
    found = lab_status(Bus(ALL, recordings()))
    assert found.rigs[0].mode is RigMode.UNKNOWN
    assert "Nobody serves" in found.rigs[0].reason
    assert found.recorder.recordings == 0


def test_a_recorder_that_waits_or_lacks_blocks_is_told():
    waits = information("a", hours=0, closed=False, waiting="No space left on device", missing_blocks=3)
    found = lab_status(Bus(ALL, recordings(waits, information("b", hours=1, missing_blocks=1))))
    assert not found.whole
    recorder = found.recorder
    assert (recorder.waiting, recorder.missing_blocks) == ("No space left on device", 4)
    assert (recorder.recordings, recorder.open_recordings, recorder.bytes) == (2, 1, 6 * 2**20)
    assert recorder.free_bytes is None


def test_only_campaigns_that_have_not_ended_are_under_way():
    made = synthetic_campaign.make(seconds=4.0, iterations=2)
    running = iterator_pb2.CampaignStatus(
        id="runs",
        phase=iterator_pb2.CAMPAIGN_PHASE_ITERATING,
        activity="playing 3",
        fraction=0.5,
        remaining_seconds=12.0,
        iterations=[synthetic_campaign.metrics(made, row) for row in range(2)],
    )
    ended = iterator_pb2.CampaignStatus(id="ended", phase=iterator_pb2.CAMPAIGN_PHASE_STOPPED)
    answers = {Keys().campaign(status.id): status for status in (running, ended)}
    entries = [information(name, hours=0, closed=False) for name in ("runs", "ended", "broken")]
    entries.append(information("closed", hours=0))
    (found,) = lab_status(Bus(ALL, answers | recordings(*entries))).campaigns
    assert (found.id, found.rig, found.playbacks, found.remaining_seconds) == ("runs", "front_axle", 2, 12.0)
    assert found.error == pytest.approx(math.sqrt((made.errors[1] ** 2).mean()))


def test_a_display_has_a_bar_for_each_stage_and_says_the_error_so_far(capsys):
    from rich.console import Console

    from duralab import RunProgress, Stage
    from duralab.data import IterationTable

    made = synthetic_campaign.make(seconds=4.0, iterations=2)
    table = IterationTable.from_messages([synthetic_campaign.metrics(made, row) for row in range(2)])
    with RunDisplay(Console(soft_wrap=True, force_terminal=True, width=200), iterations=7) as display:
        display.show(RunProgress(Stage.TARGET, "One channel is left out.", 0.0, -1.0, lasting=True))
        display.show(RunProgress(Stage.TARGET, "driving", 0.5, 3.0))
        display.show(RunProgress(Stage.CAMPAIGN, "playing 3", 0.4, 65.0, table))
    shown = capsys.readouterr().out
    assert shown.count("target: One channel is left out.") == 1
    assert "1:05 left" in shown
    assert f"playing 3 · 2/7 played, error {table.overall[-1]:.3f}" in shown
    with RunDisplay(Console(soft_wrap=True), stages=(Stage.IDENTIFICATION,)) as display:
        display.show(RunProgress(Stage.IDENTIFICATION, "exciting", 0.1, -1.0))
    assert capsys.readouterr().out == "identification: exciting\n"
