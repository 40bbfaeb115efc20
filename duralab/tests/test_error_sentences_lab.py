"""Error sentences of a lab, its campaigns and its recordings that no command provokes by a mistake in its files."""

import asyncio
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import duralab
from duralab.campaign import PartialSettings, decision_settings, load_campaign, parse_campaign
from duralab.cli.application import app
from duralab.cli.commands.export import write_frf
from duralab.data import Channel, Signals
from duralab.errors import InputError, LabError, NotReadyError
from duralab.lab import Catalogue, async_lab
from duralab.lab.campaign_running import resume_campaign, specification_of, stop_campaign
from duralab.lab.campaign_starting import begin_campaign
from duralab.lab.client import LabClient
from duralab.lab.deciding import decide
from duralab.lab.endurance import EnduranceTest
from duralab.lab.fetching import wait_until_closed
from duralab.lab.known_before import fill_known
from duralab.lab.project_running import _require_same_target
from duralab.lab.recordings_folder import RecordingsPlace
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, recorder_pb2

DEMO = load_campaign("front_axle_demo")
SAID = {"proposal": 1, "name": "Ada", "reason": "too rough", "from_iteration": 0}


class Answering:
    """A session on the bus that answers each kind of question with a message, else with an empty one."""

    def __init__(self, *answers):
        self.keys = Keys()
        self._answers = {type(answer): answer for answer in answers}

    def query(self, _key, _request, kind, **_):
        return self._answers.get(kind, kind())


def ask(*answers):
    return LabClient(Answering(*answers), lambda: None)


def steps(message):
    step = recorder_pb2.RecordedStep(message_type=message.DESCRIPTOR.full_name, payload=message.SerializeToString())
    return recorder_pb2.RecordedSteps(steps=[step], total=1)


CAMPAIGN = steps(iterator_pb2.CampaignSpec(id="demo", rig="front_axle", scenario=DEMO.text))


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (5, r"^settings is 5; give a mapping, or the path of a file\.$"),
        ({}, r"^settings is empty; at a hold point `update`, `control_band` or both change"),
        ({"stop": {}}, r"^settings has stop; at a hold point `update`, `control_band` or both change"),
    ],
)
def test_what_cannot_change_at_a_hold_point_is_told(settings, sentence):
    with pytest.raises(InputError, match=sentence):
        decision_settings(settings)


@pytest.mark.parametrize(
    ("kind", "settings", "changes", "sentence"),
    [
        ("change", None, {}, r"^The decision is change with no settings; `change`, and no other decision, has"),
        ("play", {"update": {}}, {}, r"^The decision is play with settings; `change`, and no other"),
        ("play", None, {"reason": " "}, r"reason"),
        ("change", {"update": {"iteration_gain": 0.5}}, {}, r"^Campaign 'demo' waits for no decision now; look at its"),
    ],
)
def test_a_decision_that_cannot_be_is_told(kind, settings, changes, sentence):
    with pytest.raises(InputError, match=sentence):
        decide(ask(CAMPAIGN), "demo", kind, settings=settings, describe=lambda _: None, **(SAID | changes))


def test_a_recording_of_something_else_is_told():
    with pytest.raises(LabError, match=r"^The recording 'weeks' is not that of a campaign: .* ''; give the id of one"):
        specification_of(ask(), "weeks")
    with pytest.raises(InputError, match=r"^The recording 'demo' is not that of an endurance test; give the id of one"):
        EnduranceTest(ask(CAMPAIGN), "demo").resume()


@pytest.mark.parametrize("id", ["*", "front axle"])
def test_one_campaign_is_named_where_one_is_needed(id):
    with pytest.raises(InputError, match=r"stands for all|is not a name of lower case letters"):
        stop_campaign(ask(), id, reason="")
    for start in ({"model": id}, {"drive": id}, {"learn_from": [id]}):
        plan = parse_campaign(DEMO.text + f"start_from: {start}\n", name="own.yaml")
        with pytest.raises(InputError, match=r"stands for all|is not a name of lower case letters"):
            fill_known(
                iterator_pb2.CampaignSpec(),
                plan.start_from,
                ask=ask(),
                rig=None,
                place=RecordingsPlace(),
                folder=Path(),
            )


def test_a_choice_that_does_not_exist_is_told():
    with pytest.raises(InputError, match=r"^The choice is 'fly'; allowed are continue, "):
        EnduranceTest(ask(), "weeks", "front_axle").decide("fly", hold=1, name="Ada", reason="x")


def test_a_recording_that_is_still_written_is_told(tmp_path):
    with pytest.raises(NotReadyError, match=r"^The recording 'demo' is still written; ask again when it is closed\.$"):
        Catalogue(ask()).fetch("demo", tmp_path)
    with pytest.raises(LabError, match=r"^The recorder did not close the recording 'demo' within -1 s\.$"):
        wait_until_closed(Answering(), "demo", seconds=-1.0)


def test_a_recorded_campaign_file_that_gives_other_settings_is_told(monkeypatch):
    monkeypatch.setattr(
        "duralab.lab.campaign_running.update_message", lambda *_, **__: iterator_pb2.CampaignSpec().update
    )
    with pytest.raises(InputError, match=r"does not give the settings that were recorded, .* instead of s\.yaml\.$"):
        resume_campaign(
            ask(CAMPAIGN),
            "demo",
            settings=PartialSettings("s.yaml", {"stop": {"iterations": 9}}),
            from_iteration=0,
            describe=lambda _: None,
            folder=Path,
            place=RecordingsPlace(),
            replace=False,
            on_progress=lambda _: None,
            deadline=None,
        )


def test_a_campaign_with_a_section_cannot_be_begun_alone():
    plan = parse_campaign(DEMO.text + "start_from: {section: {from: 0, to: 5, iterations: 2}}\n", name="own.yaml")
    with pytest.raises(InputError, match=r"^start_from\.section makes two campaigns, .* `duralab run`, or leave"):
        begin_campaign(None, plan, on_progress=None, deadline=None)


def test_results_of_another_target_are_told(tmp_path, recording_path):
    (tmp_path / "rough").mkdir()
    shutil.copy(recording_path, tmp_path / "rough" / "recording.mcap")
    event = SimpleNamespace(name="rough")
    run = SimpleNamespace(folder_of=lambda event: tmp_path / event.name)
    other = Signals((Channel("left", "N"),), 100.0, np.zeros((1, 100)))
    with pytest.raises(InputError, match=r"recording\.mcap was made for another target than event 'rough' has now; "):
        _require_same_target(run, event, SimpleNamespace(edited=SimpleNamespace(signals=other)))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"rigs": ()}, r"^rigs is \(\); give the names of one rig or more"),
        ({"rigs": "front_axle"}, r"^rigs is 'front_axle'; give the names"),
        ({"trace_folder": "nowhere"}, r"^trace_folder is 'nowhere', which is not an existing folder; make it\.$"),
    ],
)
def test_a_lab_that_cannot_be_started_is_told(changes, sentence):
    with pytest.raises(InputError, match=sentence), duralab.start(**changes):
        pass


def test_who_awaits_cancels_the_task():
    async def script():
        with ThreadPoolExecutor(1) as threads:
            await async_lab.AsyncLab(None, threads).run("front_axle_demo", cancel=object())

    with pytest.raises(InputError, match=r"^cancel is given; leave it out, and cancel the task that awaits\.$"):
        asyncio.run(script())


def test_a_model_without_a_line_is_not_exported(tmp_path):
    model = SimpleNamespace(frf=np.full((5, 1, 1), np.nan))
    with pytest.raises(InputError, match=r"a\.uff is not written: .* no line that was identified; identify again\.$"):
        write_frf(model, tmp_path / "a.uff", replace=False)


def test_a_sweep_with_failed_campaigns_tells_the_first(tmp_path, monkeypatch):
    failed = SimpleNamespace(failed=[{"sentence": "The drive is beyond its limit."}], total=2)
    monkeypatch.setattr("duralab.sweeps.run_sweep", lambda *_, **__: None)
    monkeypatch.setattr("duralab.sweeps.read_results", lambda _: failed)
    monkeypatch.setattr("duralab.cli.commands.sweep._conclude", lambda *_: None)
    done = CliRunner().invoke(app, ["sweep", "fifty_gains_and_seeds", "--out", str(tmp_path)])
    assert done.exit_code == 1
    assert done.stderr.endswith(
        "1 of 2 campaigns failed, the first with: The drive is beyond its limit. --retry-failed runs them again.\n"
    )
