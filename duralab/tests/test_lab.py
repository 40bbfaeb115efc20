"""The SDK over a real bus, with real processes that are fakes of the services."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import fake_lab
import numpy as np
import pytest
import synthetic_campaign
import yaml
from ended_processes import alive
from test_campaign_file import CONTENT, changed

import duralab
from duralab.campaign import parse_campaign
from duralab.errors import CampaignFaultError, InputError, LabError, ServiceEndedError
from duralab.lab.campaign_running import free_id
from duralab_bus import BusConfig, FaultError, open_bus
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2


def short_campaign(tmp_path, **changes):
    content = yaml.safe_load(yaml.safe_dump(CONTENT))
    content["target"]["road"]["duration"] = 4.0
    content["stop"]["iterations"] = 2
    content.update(changes)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    out = tmp_path_factory.mktemp("lab")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", f"{Path(__file__).parent / 'fakes'}{os.pathsep}{Path(__file__).parent}")
        with duralab.start(out) as lab:
            yield lab


def test_rigs_describe_themselves(lab):
    rigs = lab.rigs()
    assert [rig.name for rig in rigs] == ["front_axle", "predecessor"]
    assert [channel.name for channel in rigs[0].responses] == list(synthetic_campaign.NAMES)
    assert rigs[0].drives[0].maximum == synthetic_campaign.LIMITS["vertical"]


def test_unknown_rig_names_those_that_are_there(lab):
    with pytest.raises(InputError, match=r"no rig 'rear_axle'; there are front_axle, predecessor"):
        lab.describe("rear_axle")
    with pytest.raises(InputError, match="Rear Axle"):
        lab.describe("Rear Axle")


def test_played_array_comes_back_as_the_rig_answers(lab):
    drive = 0.001 * np.random.default_rng(1).standard_normal((6, 2000))
    seen = []
    played = lab.play("front_axle", drive, on_progress=seen.append)
    np.testing.assert_allclose(played.response.samples, fake_lab.response_to(drive))
    assert played.real_time_factor == 100.0
    assert any(progress.activity == "playing" for progress in seen)
    labelled = duralab.Signals(lab.describe("front_axle").drives, 1000.0, drive).to_xarray()
    np.testing.assert_array_equal(lab.play("front_axle", labelled).response.samples, played.response.samples)


@pytest.mark.parametrize(
    ("drive", "part"),
    [
        (np.zeros((5, 100)), r"shape \(5, 100\); rig 'front_axle' needs \(6, samples\)"),
        (np.zeros(100), r"shape \(100,\)"),
        (np.full((6, 100), 9.0), "exceeds its limit"),
    ],
)
def test_wrong_drive_is_refused(lab, drive, part):
    with pytest.raises(InputError, match=part):
        lab.play("front_axle", drive)


def test_drive_that_is_not_finite_is_refused_before_it_is_sent(lab):
    drive = np.zeros((6, 100))
    drive[3, 7] = np.nan
    with pytest.raises(LabError, match="nan"):
        lab.play("front_axle", drive)


DRIVE = np.zeros((6, 100))


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda lab: lab.play("front_axle", DRIVE, seed=1.5), "The seed is 1.5; it must be a whole number"),
        (lambda lab: lab.play("front_axle", DRIVE, seed=True), "The seed is True"),
        (lambda lab: lab.play("front_axle", [[1, 2], [3]]), "rows have the same length"),
        (lambda lab: lab.play("front_axle", "x"), "The drive holds text"),
        (lambda lab: lab.play("front_axle", DRIVE, timeout_seconds="x"), "timeout_seconds is 'x'; it must be a number"),
        (lambda lab: lab.play("front_axle", DRIVE, timeout_seconds=True), "timeout_seconds is True"),
        (lambda lab: lab.play("front_axle", DRIVE, cancel="x"), "give a threading.Event"),
        (lambda lab: lab.play("front_axle", DRIVE, on_progress="x"), "on_progress is 'x'; give a function"),
        (lambda lab: lab.play("front_axle", DRIVE, real_time="x"), "real_time is 'x'; give True or False"),
        (lambda lab: lab.play("front_axle", DRIVE, run=5), "run is 5; give a text"),
        (lambda lab: lab.stop_rig("front_axle", reason=5), "reason is 5; give a text"),
        (lambda lab: lab.run(None), "The campaign is None; give the path of its file"),
        (lambda lab: lab.run("front_axle_demo", out=5), "out is 5; give the path of a folder"),
        (lambda lab: lab.run("front_axle_demo", on_progress="x"), "on_progress is 'x'"),
        (lambda lab: lab.resume("demo", settings=5), "The campaign is 5"),
        (lambda lab: lab.resume("demo", out=5), "out is 5"),
        (lambda lab: lab.resume("demo", from_iteration="x"), "from_iteration is 'x'"),
        (lambda lab: lab.stop("demo", reason=5), "reason is 5; give a text"),
        (lambda lab: lab.identify("front_axle", None, None), "excitation is None; give ExcitationSettings"),
        (lambda lab: lab.watch(kinds=5), "kinds is 5; give a list of signals"),
        (lambda lab: lab.watch(kinds=["x"]), "give a list of signals"),
        (lambda lab: lab.watch(timeout_seconds="x"), "timeout_seconds is 'x'"),
    ],
)
def test_an_argument_of_another_type_is_refused_in_one_sentence(lab, ask, said):
    with pytest.raises(InputError) as caught:
        ask(lab)
    assert said in str(caught.value)


def test_numbers_of_numpy_are_numbers(lab):
    played = lab.play(
        "front_axle", DRIVE, seed=np.int64(3), real_time=np.bool_(False), timeout_seconds=np.float32(60.0)
    )
    assert played.response.samples.shape == (6, 100)


def test_campaign_runs_to_its_result(lab, tmp_path):
    seen = []
    result = lab.run(short_campaign(tmp_path), out=tmp_path / "out", on_progress=seen.append)
    assert len(result.iterations) == 2
    assert {progress.stage for progress in seen} == {duralab.Stage.TARGET, duralab.Stage.CAMPAIGN}
    assert result.recording.specification.id == "demo"
    assert result.live_path.exists()
    assert "left vertical" in str(result)
    assert result.report().name == "report.html"
    # The target is what the vehicle answered to the road, in the rig's order.
    target = result.specification.target
    assert [c.name for c in target.channels] == list(synthetic_campaign.NAMES)
    samples = np.frombuffer(target.samples.data).reshape(6, 4000)
    assert np.std(samples[0]) > 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["live.rrd", "recording.mcap", "report.html"]


@pytest.mark.parametrize(
    ("path", "value", "part"),
    [
        ("rig", "rear", "no rig 'rear'"),
        ("target.vehicle", "truck", "no rig 'truck'"),
        ("target.vehicle", "front_axle", "a rig that plays roads has left_height"),
        ("excitation.highest_frequency", 600, r"600 Hz; it must be below 500 Hz"),
        ("excitation.rms", {"left_vertical": 0.1}, "no value for left_lateral"),
        ("excitation.rms", 0.05, r"leaves room for 0\.0416667 m RMS"),
        ("update.iteration_gain", {"rear": 0.5}, "unknown channel rear"),
        ("excitation.duration", 3601.0, "plays 3600 s at most"),
        ("estimator.block_samples", 40_000, "without its fades lasts only 28 s"),
        ("target.road.duration", 1.0, r"target\.road"),
        ("target.road.potholes", {"count": 900, "depth": [0.01, 0.02], "length": [0.4, 1.0]}, "do not fit"),
    ],
)
def test_campaign_that_does_not_fit_the_rig_is_refused_before_it_starts(lab, path, value, part):
    campaign = parse_campaign(changed(path, value), name="x")
    with pytest.raises(InputError, match=part):
        lab.run(campaign)


def test_taken_name_gets_a_number(lab, monkeypatch, tmp_path):
    class Recordings:
        recordings = (type("R", (), {"recording": "mine"}), type("R", (), {"recording": "mine-2"}))

    monkeypatch.setattr(lab._ask, "query", lambda *_, **__: Recordings)
    assert free_id(lab._ask, "mine") == "mine-3"
    assert free_id(lab._ask, "other") == "other"


def test_connected_script_sees_the_same_lab(lab):
    with duralab.connect(lab.endpoints[0]) as other:
        assert [rig.name for rig in other.rigs()] == ["front_axle", "predecessor"]
        assert other.process_ids == {}


def test_endpoint_where_nothing_listens_is_explained():
    with pytest.raises(InputError, match=r"127\.0\.0\.1:9"), duralab.connect("tcp/127.0.0.1:9"):
        pass


def test_endpoint_of_the_wrong_form_is_explained():
    with pytest.raises(InputError, match=r"'here' is not of the form"), duralab.connect("here"):
        pass


def test_port_in_use_is_explained(lab, tmp_path):
    with pytest.raises(InputError, match="in use"), duralab.start(tmp_path, listen=lab.endpoints[0]):
        pass


def test_dying_service_ends_the_run_with_a_clear_error(fake_services, monkeypatch, tmp_path):
    monkeypatch.setenv("FAKE_ITERATOR", "die")
    with duralab.start(tmp_path / "lab") as lab:
        pids = list(lab.process_ids.values())
        with pytest.raises(ServiceEndedError, match=r"iterator ended by itself \(exit code 7\)"):
            lab.run(short_campaign(tmp_path), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert not any(alive(pid) for pid in pids)


def test_faulted_campaign_says_why(lab, tmp_path, monkeypatch):
    fault = query_pb2.Fault(message="The rig is interlocked: it met a limit.", service="rig_sim")
    status = iterator_pb2.CampaignStatus(id="mine", phase=iterator_pb2.CAMPAIGN_PHASE_FAULTED, fault=fault)
    monkeypatch.setattr("duralab.lab.campaign_starting.followed", lambda *_, **__: status)
    with pytest.raises(CampaignFaultError, match="The rig is interlocked") as caught:
        lab.run(short_campaign(tmp_path), out=tmp_path / "out")
    assert caught.value.service == "rig_sim"


@pytest.mark.parametrize("end", ["", ".", " "])
def test_a_fault_without_a_full_stop_does_not_run_into_the_sentence_after_it(lab, tmp_path, monkeypatch, end):
    status = fake_lab.final_status("mine", iterations=2)
    status.phase = iterator_pb2.CAMPAIGN_PHASE_FAULTED
    status.fault.message = f"The rig was stopped: no reason was given{end}"
    monkeypatch.setattr("duralab.lab.campaign_starting.followed", lambda *_, **__: status)
    with pytest.raises(CampaignFaultError) as caught:
        lab.run(short_campaign(tmp_path), out=tmp_path / "out")
    assert "stopped: no reason was given. What was played until then is in " in str(caught.value)


def test_recording_that_comes_damaged_is_not_kept(lab, tmp_path, monkeypatch):
    def with_a_wrong_hash(_bus, id):
        return recorder_pb2.RecordingInfo(recording=id, closed=True, file_hash="0" * 64)

    monkeypatch.setattr("duralab.lab.fetching.wait_until_closed", with_a_wrong_hash)
    with pytest.raises(LabError, match="SHA-256"):
        lab.run(short_campaign(tmp_path), out=tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_recording_with_holes_is_no_result(lab, tmp_path, monkeypatch):
    holes = recorder_pb2.RecordingInfo(closed=True, missing_blocks=3)
    monkeypatch.setattr("duralab.lab.fetching.wait_until_closed", lambda *_: holes)
    with pytest.raises(LabError, match="lacks 3 signal blocks"):
        lab.run(short_campaign(tmp_path), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_service_killed_while_it_plays_gives_an_error_and_no_hang(fake_services, monkeypatch, tmp_path):
    monkeypatch.setenv("FAKE_RIG", "hang")
    with duralab.start(tmp_path / "lab") as lab:
        killer = threading.Timer(0.5, os.kill, (lab.process_ids["rig_sim"], signal.SIGKILL))
        killer.start()
        with pytest.raises(ServiceEndedError, match="rig_sim ended by itself"):
            lab.play("front_axle", np.zeros((6, 100)))
        killer.join()


def test_importing_duralab_is_quick():
    heavy = ["numpy", "zenoh", "pydantic", "xarray", "plotly", "rich"]
    code = f"import sys, duralab; sys.exit(any(name in sys.modules for name in {heavy}))"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        (query_pb2.FAULT_CODE_INVALID_ARGUMENT, InputError),
        (query_pb2.FAULT_CODE_BUSY, duralab.BusyError),
        (query_pb2.FAULT_CODE_FAILED_PRECONDITION, duralab.NotReadyError),
        (query_pb2.FAULT_CODE_CANCELLED, duralab.StoppedError),
        (query_pb2.FAULT_CODE_UNAVAILABLE, duralab.UnavailableError),
        (query_pb2.FAULT_CODE_DEADLINE_EXCEEDED, TimeoutError),
        (query_pb2.FAULT_CODE_DATA_LOSS, LabError),
    ],
)
def test_each_fault_is_an_error_of_its_kind_with_field_and_service(lab, code, kind):
    error = lab._ask.explained(FaultError(code, "It failed.", field="drive", service="rig_sim"))
    assert isinstance(error, kind)
    assert isinstance(error, LabError)
    assert (str(error), error.field, error.service) == ("It failed.", "drive", "rig_sim")


def test_a_drive_with_names_is_put_in_the_order_of_the_rig(lab):
    drive = 0.001 * np.random.default_rng(1).standard_normal((6, 200))
    labelled = duralab.Signals(lab.describe("front_axle").drives, 1000.0, drive).to_xarray()
    played = lab.play("front_axle", labelled[::-1])
    np.testing.assert_allclose(played.response.samples, fake_lab.response_to(drive))


def test_a_lab_that_is_not_there_or_not_whole_is_said():
    with pytest.raises(InputError, match="tcp/127"), duralab.connect("tcp/127.0.0.1:9", timeout_seconds=0.1):
        pass
    alone = open_bus(BusConfig(listen=("tcp/127.0.0.1:0",)), service="nobody")
    with (
        alone,
        pytest.raises(duralab.UnavailableError, match="not complete"),
        duralab.connect(alone.listening[0], timeout_seconds=0.1),
    ):
        pass
