"""Campaign files and measured files over HTTP: checked as the command line does, bounded, read by another process."""

import subprocess
import sys

import numpy as np
import pytest
import yaml
from page_lab import RIG, Client, campaign, write_target

import duralab
from duralab.formats import read_signals

UNICODE = "é <b>&amp;</b> \u202e"


@pytest.fixture(scope="module")
def page(page_lab):
    return page_lab.page("files", largest_upload_mebibytes=1)


@pytest.fixture(scope="module")
def client(page):
    return Client(page.address)


def upload(client, name, content):
    headers = {"X-Duralab-Page": client.version, "X-Duralab-Token": client.token}
    return client.request("POST", f"/api/uploads/{name}", content, headers)[:2]


@pytest.fixture(scope="module")
def uploaded(page_lab, client, tmp_path_factory):
    path = write_target(tmp_path_factory.mktemp("made") / "road.rsp", page_lab.rig)
    status, found = upload(client, "my%20road%20(1).rsp", path.read_bytes())
    assert status == 200, found
    return path, found


def test_a_measured_file_is_kept_under_its_content_and_shown_with_every_peak(page, uploaded):
    path, found = uploaded
    samples = read_signals(path).samples
    assert [each["name"] for each in found["channels"]] == [each.name for each in read_signals(path).channels]
    assert (found["sample_rate"], found["seconds"]) == (1000.0, 6.0)
    for row in range(2):
        assert max(found["high"][row]) == pytest.approx(samples[row].max(), rel=1e-3)
        assert min(found["low"][row]) == pytest.approx(samples[row].min(), rel=1e-3)
    assert found["file"].startswith("uploads/my_road_1_-")
    assert (page.files / found["file"]).read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.exe", b"MZ", "of no known kind"),
        ("a.rsp", b"", ""),
        ("a.rsp", b"FORMAT" + bytes(5000), ""),
        ("a.csv", b"\xff\xfe\x00" * 1000, ""),
        ("a.mat", b"MATLAB 5.0" + b"\x00" * 200, ""),
        ("a.rsp", bytes(1024 * 1024 + 1), "larger than 1 MiB"),
        ("..%2f..%2fevil.rsp", b"x", ""),
        ("%00.rsp", b"x", ""),
    ],
)
def test_what_is_no_measured_file_is_refused_in_a_sentence_and_leaves_nothing(
    page, client, uploaded, name, content, said
):
    before = sorted(page.files.rglob("*"))
    status, answer = upload(client, name, content)
    assert status in (400, 404), answer
    if isinstance(answer, dict):
        assert said in answer["error"]
        assert str(page.files) not in answer["error"]
    assert sorted(page.files.rglob("*")) == before


def test_a_file_that_kills_who_reads_it_kills_no_page(monkeypatch):
    from operator_page import child

    monkeypatch.setattr(subprocess, "run", lambda *a, **k: subprocess.CompletedProcess(a, -9, b"", b""))
    with pytest.raises(duralab.InputError, match="its process ended early"):
        child.work("read", "x")
    monkeypatch.undo()
    done = subprocess.run(
        [sys.executable, "-m", "operator_page.child"], input=b"no pickle", capture_output=True, check=False
    )
    assert done.returncode not in (0, 2)


def test_a_campaign_is_checked_by_the_models_of_the_command_line_and_saved_as_its_file(page, client, uploaded):
    _, found = uploaded
    document = campaign("mine", target={"file": found["file"]})
    status, answer = client.post("/api/campaign_files", {"document": document})
    assert (status, answer["rig_is_here"]) == (200, True)
    assert not (page.files / "mine.yaml").exists()
    assert client.post("/api/campaign_files", {"document": document, "save": True})[0] == 200
    assert (page.files / "mine.yaml").read_text() == answer["text"]
    plan = duralab.load_campaign(page.files / "mine.yaml")
    assert plan.update.iteration_gain == 0.5
    assert client.get("/api/campaign_files")[1]["files"] == ["mine"]
    read = client.get("/api/campaign_files/file/mine")[1]["document"]
    assert read["target"]["file"] == found["file"]
    assert client.post("/api/campaign_files", {"document": read, "save": True})[1]["error"].startswith(
        "There is a file 'mine' already"
    )
    assert client.post("/api/campaign_files", {"document": read, "save": True, "replace": True})[0] == 200


def test_a_campaign_without_its_road_is_listed_with_the_reason_and_begins_nothing(client):
    missing = client.get("/api/campaign_files")[1]["unavailable"]
    assert list(missing) == ["shipped:belgian_block"]
    assert missing["shipped:belgian_block"].startswith(
        "Its road belgian_block.crg is missing in the folder in which this page was started; it is crg-bin/"
    )
    status, answer = client.act("/api/campaigns", {"kind": "shipped", "name": "belgian_block"})
    assert (status, answer["field"]) == (400, "name")
    assert answer["error"] == f"belgian_block cannot begin. {missing['shipped:belgian_block']}"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"update": {"kind": "basic_twr", "iteration_gain": 2.0}}, "update.iteration_gain"),
        ({"update": {"kind": "basic_twr", "gains": 0.5}}, "gains"),
        ({"name": "../evil"}, "name"),
        ({"name": UNICODE}, "name"),
        ({"target": {"file": "/etc/passwd"}}, "give a file that was put on this page"),
        ({"target": {"file": "../../lab/logs/recorder.log"}}, "give a file that was put on this page"),
        ({"target": {"opencrg": {"path": "/etc/passwd", "duration": 9.0}, "vehicle": "v"}}, "put on this page"),
        ({"excitation": None}, "excitation"),
    ],
)
def test_a_document_that_does_not_fit_is_refused_with_its_key(page, client, changes, said):
    status, answer = client.post("/api/campaign_files", {"document": campaign("x") | changes, "save": True})
    assert status == 400
    assert said in answer["error"] or said in answer["field"]
    assert not (page.files / "x.yaml").exists()


def test_a_target_is_shown_before_and_after_its_edits_with_the_damage_kept(client, uploaded):
    path, found = uploaded
    edit = [{"filter": {"low_pass": 20.0}}, {"shorten_by_damage": {"keep": 0.9}}]
    first, second = (each["name"] for each in found["channels"])
    target = {"file": found["file"], "channels": {first: {"from": second, "scale": -1.0}}, "edit": edit}
    status, answer = client.post("/api/target_preview", {"document": campaign("shown", target=target)})
    assert status == 200, answer
    assert max(answer["before"]["high"][0]) == pytest.approx(-read_signals(path).samples[1].min(), rel=1e-3)
    assert [step["name"] for step in answer["steps"]] == ["read_file", "filter", "shorten_by_damage"]
    assert answer["after"]["seconds"] < answer["before"]["seconds"]
    assert all(0.85 < kept <= 1.0 for kept in answer["steps"][2]["damage_kept"].values())
    road = campaign("shown", target={"road": {"iso_class": "C", "seed": 1, "duration": 9.0}, "vehicle": "v"})
    assert "comes from a road" in client.post("/api/target_preview", {"document": road})[1]["error"]


def test_a_template_for_the_rig_is_whole_but_for_its_target(client):
    document = client.get(f"/api/rigs/{RIG}/template")[1]["document"]
    assert document["rig"] == RIG
    assert client.post("/api/campaign_files", {"document": document})[0] == 200
    schema = client.get("/api/campaign_schema")[1]
    assert set(document) <= set(schema["properties"])
    # Every key of the form has its help.
    parts = [schema, *schema["$defs"].values()]
    silent = [
        key
        for part in parts
        for key, one in part.get("properties", {}).items()
        if not one.get("description") and "$ref" not in one
    ]
    assert silent == []


def test_a_recording_is_found_verified_reported_and_exported(page_lab, client, page, uploaded, tmp_path):
    document = campaign("recorded", target={"file": uploaded[1]["file"]}, hold="never")
    document["stop"] = {"iterations": 2}
    (page.files / "recorded.yaml").write_text(yaml.safe_dump(document))
    assert client.act("/api/campaigns", {"kind": "file", "name": "recorded"})[0] == 200
    client.wait_for(lambda lab: any(one["id"] == "recorded" and one["ended"] for one in lab["campaigns"]))
    found = client.get(f"/api/recordings?rig={RIG}")[1]
    assert [(one["id"], one["closed"]) for one in found["recordings"]] == [("recorded", True)]
    assert client.get("/api/recordings?rig=other")[1]["recordings"] == []
    assert client.get("/api/recordings?result=nonsense")[0] == 400
    assert client.post("/api/recordings/recorded/verify") == (200, {"findings": []})
    status, report, headers = client.request("GET", "/api/recordings/recorded/report")
    assert status == 200
    assert b"<!doctype html>" in report[:100].lower()
    # It runs its scripts in an origin of its own.
    assert headers["content-security-policy"].startswith("sandbox allow-scripts")
    assert "allow-same-origin" not in headers["content-security-policy"]
    status, content, headers = client.request("GET", "/api/recordings/recorded/export/target/rsp")
    assert (status, headers["content-disposition"]) == (200, 'attachment; filename="recorded.target.rsp"')
    (tmp_path / "t.rsp").write_bytes(content)
    wanted = duralab.open(page_lab.lab.catalogue.fetch("recorded", tmp_path)).target.samples
    np.testing.assert_allclose(read_signals(tmp_path / "t.rsp").samples, wanted, atol=1e-3 * np.abs(wanted).max())
    for path in ("nowhere/report", "nowhere/export/drive/rsp", "recorded/export/frf/rsp", "recorded/export/drive/exe"):
        assert client.get(f"/api/recordings/{path}")[0] in (400, 404), path
    assert client.get("/api/comparison?id=recorded")[0] == 400
