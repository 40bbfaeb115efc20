"""Who may do what over HTTP, and what every request has to show."""

import json
import socket
import time

import numpy as np
import pytest
from page_lab import RIG, Client, campaign

import duralab
from duralab import RigMode
from duralab.formats import read_signals

READS = (
    "/api/stream",
    "/api/campaign_files",
    "/api/campaign_files/shipped/front_axle_demo",
    "/api/campaign_schema",
    f"/api/rigs/{RIG}",
    f"/api/rigs/{RIG}/template",
    "/api/recordings",
    "/api/schedules",
)
DECISION = {"kind": "play", "proposal": 1, "reason": "x"}
# Of each command: values, and what an operator gets: 200, or a refusal by the lab, which is no refusal of a role.
COMMANDS = {
    "/api/arm": ({"action": "/api/stop", "values": {}, "seen": 0}, 409),
    "/api/stop": ({}, 200),
    f"/api/rigs/{RIG}/stop": ({}, 200),
    "/api/campaigns/none/stop": ({}, 400),
    f"/api/rigs/{RIG}/take": ({}, 409),
    f"/api/rigs/{RIG}/release": ({}, 200),
    f"/api/rigs/{RIG}/reset": ({"reason": "x"}, 409),
    "/api/campaigns": ({"kind": "shipped", "name": "front_axle_demo"}, 409),
    "/api/campaigns/none/decide": (DECISION, 409),
    "/api/campaigns/none/resume": ({}, 409),
    f"/api/rigs/{RIG}/pre_test": ({}, 409),
    "/api/campaign_files": ({"document": {}}, 400),
    "/api/target_preview": ({"document": {}}, 400),
    "/api/pre_test_levels": ({"document": {}}, 400),
    "/api/uploads/none.rsp": ({}, 400),
    "/api/recordings/none/verify": ({}, 400),
    "/api/schedules": ({"document": {}}, 400),
    "/api/endurance": ({"name": "none"}, 409),
    "/api/endurance/none/hold": ({"reason": "x"}, 409),
    "/api/endurance/none/decide": ({"kind": "continue", "hold": 1, "reason": "x"}, 409),
    "/api/endurance/none/stop": ({"reason": "x"}, 409),
    "/api/endurance/none/resume": ({}, 409),
}


@pytest.fixture(scope="module")
def page(page_lab):
    return page_lab.secured_page("secured")


@pytest.fixture
def signed_in(page):
    """A client for each name; the lab's rig is held by none afterwards."""
    clients = {}
    for name in ("Ada", "Grace", "Vera"):
        clients[name] = Client(page.address)
        assert clients[name].sign_in(name)[0] == 200
    yield clients
    for name in ("Ada", "Grace"):
        clients[name].post(f"/api/rigs/{RIG}/release")


def test_nobody_who_is_not_signed_in_sees_or_does_anything(page):
    stranger = Client(page.address)
    assert set(stranger.open()) == {"version", "accounts", "viewer"}
    for path in READS:
        assert stranger.get(path)[0] == 401
    for path, (values, _) in COMMANDS.items():
        assert stranger.post(path, values)[0] == 401, path


def test_a_viewer_sees_all_and_does_nothing(signed_in):
    viewer = signed_in["Vera"]
    # The page serves before it has heard of a rig.
    assert viewer.wait_for(lambda document: document["rigs"])["rigs"][0]["name"] == RIG
    for path in READS[1:]:
        assert viewer.get(path)[0] == 200
    for path, (values, _) in COMMANDS.items():
        status, answer = viewer.post(path, values)
        assert (status, answer["error"]) == (403, "Vera is a viewer; ask an operator to do this."), path


def test_every_command_is_in_the_table_and_an_operator_gets_to_the_lab(page_lab, signed_in):
    from operator_page.config import PageConfig
    from operator_page.server import PageServer

    server = PageServer(lab=None, view=None, commands=None, config=PageConfig(), accounts=None)
    commands = {each.path for each in server.endpoints if each.method == "POST" and each.role == "operator"}
    tried = {path.replace(RIG, "{rig}").replace("none.rsp", "{name}").replace("none", "{id}") for path in COMMANDS}
    assert commands - tried == set()
    operator = signed_in["Ada"]
    for path, (values, wanted) in COMMANDS.items():
        assert operator.post(path, values)[0] == wanted, path
    # The stops above latched it.
    page_lab.lab.reset(RIG)


def test_a_stop_is_answered_in_a_moment_and_names_who_did_it(page_lab, signed_in):
    ada = signed_in["Ada"]
    seconds = []
    for _ in range(3):
        began = time.monotonic()
        assert ada.post(f"/api/rigs/{RIG}/stop", {"reason": "it <b>smokes</b>"})[0] == 200
        seconds.append(time.monotonic() - began)
    # Whatever else the machine does, one of them shows that nothing waits for the rig.
    assert min(seconds) < 0.2
    state = ada.wait_for(lambda lab: lab["rigs"][0]["mode"] == "interlocked")
    assert state["rigs"][0]["reason"] == "it <b>smokes</b> (Ada, at the operator page)"
    assert page_lab.lab.state(RIG).mode is RigMode.INTERLOCKED
    assert ada.act(f"/api/rigs/{RIG}/reset", {"reason": "looked at it"}) == (200, {"mode": "idle"})
    document = ada.wait_for(lambda lab: lab["rigs"][0]["mode"] == "idle")
    lines = [(line["who"], line["text"]) for line in document["log"]]
    assert ("Ada", f"Reset of {RIG}: looked at it") in lines
    assert ("", f"{RIG}: idle. Reset by Ada: looked at it") in lines
    assert document["rigs"][0]["reset"] == "Reset by Ada: looked at it"
    state = page_lab.lab.state(RIG)
    assert (state.reset_name, state.reset_reason) == ("Ada", "looked at it")


def test_a_reset_without_a_reason_or_with_one_that_cannot_be_shown_is_refused(page_lab, signed_in):
    ada = signed_in["Ada"]
    path = f"/api/rigs/{RIG}/reset"
    assert ada.post(f"/api/rigs/{RIG}/stop", {"reason": "a test"})[0] == 200
    for values in ({}, {"reason": "  "}, {"reason": "x" * 301}, {"reason": "a\x07"}, {"reason": "a\nb"}):
        status, answer = ada.act(path, values)
        assert (status, answer["field"]) == (400, "reason"), values
        assert answer["error"].endswith(".")
    assert page_lab.lab.state(RIG).mode is RigMode.INTERLOCKED
    assert ada.act(path, {"reason": "x" * 300})[0] == 200


def test_a_motion_needs_two_acts_with_the_same_values_and_fresh_data(signed_in):
    ada, grace = signed_in["Ada"], signed_in["Grace"]
    path, values, now = f"/api/rigs/{RIG}/reset", {"reason": "x"}, time.time()
    assert ada.post(path, {**values, "seen": now})[0] == 428
    assert ada.post(path, {**values, "seen": now, "word": ["x"]})[0] == 428
    word = ada.post("/api/arm", {"action": path, "values": values, "seen": now})[1]["word"]
    assert grace.post(path, {**values, "seen": now, "word": word})[0] == 428
    word = ada.post("/api/arm", {"action": path, "values": values, "seen": now})[1]["word"]
    assert ada.post(path, {"reason": "y", "seen": now, "word": word})[0] == 428
    for seen in (now - 4.0, now + 60.0, None, "now", True, 1e400):
        status, answer = ada.act(path, values, seen=seen)
        assert (status, answer["field"]) == (409, "seen"), seen
    assert ada.act(path, values)[0] == 200


def test_who_holds_the_rig_is_shown_and_taking_over_is_explicit(signed_in):
    ada, grace = signed_in["Ada"], signed_in["Grace"]
    assert ada.act(f"/api/rigs/{RIG}/reset", {"reason": "mine"})[0] == 200
    assert grace.lab()["rigs"][0]["holder"]["name"] == "Ada"
    status, answer = grace.act(f"/api/rigs/{RIG}/reset", {"reason": "mine"})
    assert (status, answer["field"]) == (409, "holder")
    assert answer["error"] == f"Ada holds the rig {RIG}; ask Ada, or take the rig over first."
    # A stop asks nobody.
    assert grace.post(f"/api/rigs/{RIG}/stop")[0] == 200
    assert grace.act(f"/api/rigs/{RIG}/take") == (200, {"holder": "Grace"})
    assert grace.act(f"/api/rigs/{RIG}/reset", {"reason": "mine"})[0] == 200
    assert ada.act(f"/api/rigs/{RIG}/reset", {"reason": "mine"})[0] == 409


def test_a_request_that_another_site_forged_is_refused(signed_in):
    ada = signed_in["Ada"]
    path = f"/api/rigs/{RIG}/release"
    assert ada.post(path)[0] == 200
    assert ada.post(path, X_Duralab_Token="")[0] == 403
    assert ada.post(path, X_Duralab_Token=signed_in["Grace"].token)[0] == 403
    assert ada.post(path, Origin="http://evil.example")[0] == 403
    assert ada.post(path, Origin=f"http://{ada.host}")[0] == 200
    # A form of another site can send no JSON without asking first.
    assert ada.post(path, Content_Type="text/plain")[0] == 415
    assert ada.post(path, Host="evil.example")[0] == 421
    assert ada.request("GET", "/", headers={"Host": "evil.example"})[0] == 421
    assert ada.post(path, X_Duralab_Page="0123456789ab")[1]["field"] == "version"


def test_a_stolen_cookie_moves_nothing_without_its_token_and_ends_with_its_session(signed_in, page):
    ada, thief = signed_in["Ada"], Client(page.address)
    thief.cookie = ada.cookie
    assert thief.post(f"/api/rigs/{RIG}/release")[0] == 403
    assert ada.post("/api/sign_out")[0] == 200
    thief.token = ada.token
    assert thief.post(f"/api/rigs/{RIG}/release")[0] == 401
    for cookie in ("", "x", "é", "a" * 5000, ada.cookie[::-1]):
        thief.cookie = cookie.encode().decode("latin-1")
        assert thief.get(f"/api/rigs/{RIG}")[0] in (400, 401, 431)


def test_a_session_expires_also_while_its_stream_is_open(page_lab):
    short = page_lab.secured_page("short", session_hours=2.0 / 3600.0)
    ada = Client(short.address)
    assert ada.sign_in("Ada")[0] == 200
    status, content, _ = ada.request("GET", "/api/stream")
    assert status == 200
    assert content.rstrip().endswith(b"event: ended\ndata: {}")
    assert ada.post(f"/api/rigs/{RIG}/stop")[0] == 401


def test_wrong_passwords_become_slow_and_say_the_same_for_all_names(page_lab):
    page = page_lab.secured_page("guessing")
    client = Client(page.address)
    answers = {json.dumps(client.sign_in(name, "wrong password")) for name in ("Ada", "Nobody")}
    assert len(answers) == 1
    tried = [client.sign_in("Ada", "wrong password")[0] for _ in range(6)]
    assert tried == 4 * [401] + 2 * [429]
    # Not only for who guesses: a name cannot be tried from elsewhere either; others may still sign in.
    assert Client(page.address).sign_in("Ada")[0] == 429
    assert client.sign_in("Grace")[0] == 200
    assert sum(line.get("event") == "sign-in refused" for line in page.log) == 6


def test_a_session_that_asks_without_end_is_slowed_but_may_always_stop(page):
    ada = Client(page.address)
    assert ada.sign_in("Ada")[0] == 200
    # Sent together, because a busy machine may not ask and answer one by one as fast as the page allows.
    request = f"GET /api/session HTTP/1.1\r\nHost: {ada.host}\r\nCookie: duralab_session={ada.cookie}\r\n\r\n"
    host, _, port = ada.host.rpartition(":")
    answers = b""
    with socket.create_connection((host, int(port)), timeout=120.0) as connection:
        connection.sendall(500 * request.encode())
        while b"HTTP/1.1 429" not in answers and (answered := connection.recv(65_536)):
            answers += answered
    assert b"HTTP/1.1 429" in answers
    assert ada.post(f"/api/rigs/{RIG}/stop")[0] == 200


def test_browsers_are_told_to_run_nothing_of_others_and_to_keep_nothing(page):
    client = Client(page.address)
    for path in ("/", "/web/app.js", "/api/session", "/nowhere"):
        _, _, headers = client.request("GET", path)
        named = {name.lower(): value for name, value in headers.items()}
        policy = named["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert (named["x-content-type-options"], named["cache-control"]) == ("nosniff", "no-store")
    cookie = client.request(
        "POST",
        "/api/sign_in",
        json.dumps({"name": "Vera", "password": "only looking, thanks"}),
        {"Content-Type": "application/json", "X-Duralab-Page": client.version},
    )[2]["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    page_text = client.request("GET", "/")[1].decode()
    assert "<script>" not in page_text
    assert "style=" not in page_text


@pytest.mark.parametrize(
    "name", ["..%2fserver.py", "../server.py", "%2e%2e/config.py", "index.html", "a%00b", 4000 * "x"]
)
def test_files_beside_the_page_are_not_served(page, name):
    assert Client(page.address).request("GET", f"/web/{name}")[0] in (400, 404)


def test_a_page_without_accounts_has_one_local_operator_whose_wrong_orders_are_refused(page_lab):
    client = Client(page_lab.page("local").address)
    document = client.open()
    assert (document["name"], document["role"], document["accounts"]) == ("local operator", "operator", False)
    assert client.act(f"/api/rigs/{RIG}/reset", {"reason": "x"})[0] == 200
    assert client.post("/api/sign_in", {"name": "Ada", "password": "x"})[0] == 409
    # What does not fit the lab is refused in a sentence.
    assert client.get("/api/rigs/nowhere")[1]["error"].startswith("There is no rig 'nowhere'")
    status, answer = client.act("/api/campaigns", {"kind": "shipped", "name": "front_axle_demo"})
    assert (status, answer["error"]) == (400, f"There is no rig 'front_axle'; there are {RIG}.")
    status, answer = client.act("/api/campaigns", {"kind": "file", "name": "missing"})
    assert status == 400
    assert "There is no campaign file" in answer["error"]


def test_a_campaign_is_begun_held_and_ended_and_its_record_says_by_whom(page_lab, page, signed_in):
    ada, grace = signed_in["Ada"], signed_in["Grace"]
    page_lab.put_campaign(page, campaign("asked"))
    page_lab.lab.reset(RIG)
    begin = {"kind": "file", "name": "asked"}
    assert ada.act("/api/campaigns", begin)[0] == 200
    seen = ada.wait_for(lambda lab: any(one["hold"] for one in lab["campaigns"]))
    (waiting,) = [one for one in seen["campaigns"] if one["hold"]]
    assert (waiting["id"], waiting["rig"], waiting["hold"]["number"]) == ("asked", RIG, 1)
    target = ada.get("/api/campaigns/asked/target")[1]
    written = read_signals(page.files / "target.rsp").samples
    line = np.linspace(written[:, 0], written[:, -1], written.shape[1], axis=1)
    assert max(value for value in target["high"][0] if value is not None) == pytest.approx(
        (written - line)[0].max(), rel=1e-3
    )
    first = ada.get("/api/campaigns/asked/proposal")[1]
    assert first["last_drive"] is None
    assert [one["name"] for one in first["predicted"]["channels"]] == [one["name"] for one in target["channels"]]
    decision = {"kind": "end", "proposal": 2, "reason": "enough"}
    assert grace.act("/api/campaigns/asked/decide", {**decision, "proposal": 1})[1]["field"] == "holder"
    assert ada.act("/api/campaigns/asked/decide", decision)[0] == 409
    assert ada.act("/api/campaigns/asked/decide", {"kind": "play", "proposal": 1, "reason": "on"})[0] == 200
    ada.wait_for(lambda lab: any(one["hold"] and one["hold"]["number"] == 2 for one in lab["campaigns"]))
    # What was proposed first was played, and the next drive lies over it.
    second = ada.get("/api/campaigns/asked/proposal")[1]
    assert (second["last_drive"]["low"], second["last_drive"]["high"]) == (
        first["drive"]["low"],
        first["drive"]["high"],
    )
    assert second["drive"]["low"] != first["drive"]["low"]
    assert ada.act("/api/campaigns/asked/decide", decision)[0] == 200
    ada.wait_for(lambda lab: all(one["ended"] for one in lab["campaigns"]))
    recording = duralab.open(page_lab.lab.catalogue.fetch("asked", page_lab.folder / "asked"))
    assert [(each.name, each.reason) for each in recording.decisions] == [
        ("Ada", "on"),
        ("Ada", "enough"),
    ]
    assert recording.specification.scenario.startswith("# Begun at the operator page by Ada.\n")
    with pytest.raises(duralab.InputError):
        page_lab.lab.catalogue.fetch("nowhere", page_lab.folder / "nowhere")
