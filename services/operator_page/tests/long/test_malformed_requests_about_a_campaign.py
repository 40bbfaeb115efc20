"""A thousand malformed requests for each endpoint about a campaign that waits, and one that ended: nothing moves."""

import copy
import json
import random
import time

import pytest
from malformed_requests import REQUESTS, VALUES, WORDS, malformed, raw
from page_lab import RIG, Client, campaign

import duralab
from duralab import RigMode
from operator_page.files import PageFiles

pytestmark = pytest.mark.timeout(900)

DECISION = {"kind": "play", "proposal": 1, "reason": "x"}
COMMANDS = {
    "/api/campaigns/held/decide": DECISION,
    "/api/campaigns/ended/resume": {"from_iteration": 1},
    "/api/campaigns": {"kind": "file", "name": "held"},
    "/api/recordings/ended/verify": {},
    "/api/arm": {"action": "/api/campaigns/held/decide", "values": DECISION},
    "/api/campaign_files": {"document": campaign("written"), "save": True},
    f"/api/rigs/{RIG}/reset": {"reason": "x"},
    f"/api/rigs/{RIG}/pre_test": {},
    f"/api/rigs/{RIG}/take": {},
    "/api/sign_in": {"name": "Ada", "password": "x"},
    "/api/sign_in_by_certificate": {},
}
# These move nothing, and need no second act; where the damage left them sound they are done.
HARMLESS = {"/api/recordings/ended/verify", "/api/campaign_files", "/api/arm"}
READS = (
    "/api/campaigns/held/target",
    "/api/campaigns/held/proposal",
    "/api/campaign_files/file/held",
    "/api/recordings/ended/report",
    "/api/recordings/ended/export/drive/rsp",
    "/api/comparison",
)


@pytest.fixture(scope="module")
def page(page_lab):
    """A page that began two campaigns: `ended` has one playback and was ended, `held` waits before its first."""
    page = page_lab.page("about_a_campaign")
    client = Client(page.address)
    for name, playbacks in (("ended", 1), ("held", 0)):
        page_lab.put_campaign(page, campaign(name))
        assert client.act("/api/campaigns", {"kind": "file", "name": name})[0] == 200
        for number in range(1, playbacks + 2):
            client.wait_for(lambda lab, name=name, number=number: waits(lab, name, number), seconds=120.0)
            if playbacks:
                decision = DECISION | {"proposal": number, "kind": "play" if number <= playbacks else "end"}
                assert client.act(f"/api/campaigns/{name}/decide", decision)[0] == 200
        if playbacks:
            client.wait_for(lambda lab: all(one["ended"] for one in lab["campaigns"]))
    return page


def waits(lab, name, number):
    return any(one["id"] == name and one["hold"] and one["hold"]["number"] == number for one in lab["campaigns"])


def playbacks(page_lab):
    (rig,) = [one for one in page_lab.lab.health() if one.service == "rig_sim"]
    return rig.value("duralab_rig_playbacks_total", rig=RIG, code="OK")


@pytest.fixture
def nothing_moves(page_lab, page):
    """Check afterwards: no playback, rig at rest and not latched, the same proposal waits, no error is logged."""
    before = playbacks(page_lab)
    yield
    assert playbacks(page_lab) == before
    state = page_lab.lab.state(RIG)
    assert (state.mode, state.run) == (RigMode.IDLE, "")
    assert page_lab.lab.proposal("held").number == 1
    assert page.process.poll() is None
    assert not [line for line in page.log if line.get("level") == "error"]


def damaged(random_one: random.Random, sound: dict) -> dict:
    """Return a document with one value exchanged, left out or added, at any depth."""
    document = copy.deepcopy(sound)
    place = document
    while inner := [
        one
        for value in place.values()
        for one in (value if isinstance(value, list) else [value])
        if isinstance(one, dict) and one
    ]:
        if random_one.random() < 0.4:
            break
        place = random_one.choice(inner)
    key = random_one.choice([*place, random_one.choice(WORDS)])
    if key in place and random_one.random() < 0.3:
        del place[key]
    else:
        place[key] = random_one.choice(VALUES)
    return document


def fresh(page) -> Client:
    # A session of its own each time: what is tried here is no rate.
    client = Client(page.address)
    client.cookie = ""
    client.open()
    return client


@pytest.mark.parametrize("path", list(COMMANDS))
def test_no_malformed_command_about_a_campaign_is_carried_out(nothing_moves, page, path):
    random_one, sound = random.Random(path), COMMANDS[path]
    client, statuses = fresh(page), set()
    for number in range(REQUESTS):
        if number % 40 == 0:
            client = fresh(page)
        headers = {
            "Content-Type": "application/json",
            "X-Duralab-Page": client.version,
            "X-Duralab-Token": client.token,
            "Cookie": f"duralab_session={client.cookie}",
        }
        if number % 2:
            body = malformed(random_one, sound)
        else:
            values = damaged(random_one, sound)
            if values == sound:
                continue
            # With fresh data, and a word that was given for the sound values.
            armed = {"action": path, "values": sound, "seen": time.time()}
            also = {"word": client.post("/api/arm", armed)[1]["word"], "seen": time.time()}
            body = json.dumps(values | also).encode("utf-8", "surrogatepass")
        status, content = raw(client, "POST", path, body, headers)
        statuses.add(status)
        assert status < 500, (status, body[:300], content)
        if status >= 400:
            assert json.loads(content)["error"].endswith((".", "?", "!")), (body[:300], content)
        else:
            assert path in HARMLESS, (path, body, content)
    assert statuses & {400, 401, 409, 428}


EDITED = {
    "file": "target.rsp",
    "edit": [{"filter": {"low_pass": 30.0}}, {"shorten_by_damage": {"keep": 0.9}}, {"taper": {"seconds": 0.5}}],
}
# Each preview that is made is a process of its own, which takes seconds.
MOST_PREVIEWS = 40


def is_previewed(page, body: bytes, rig) -> bool:
    """Return whether the body still holds a campaign that can be checked: its target is made then."""
    try:
        document = json.loads(body)["document"]
        assert document["rig"] == RIG
        PageFiles(page.files, largest_bytes=0).checked(document, rig)
    except (ValueError, KeyError, TypeError, AssertionError, AttributeError, RecursionError, duralab.LabError):
        return False
    return True


def test_no_malformed_preview_of_the_target_of_a_campaign_fails(nothing_moves, page_lab, page):
    random_one, sound = random.Random("preview"), {"document": campaign("held", target=EDITED)}
    rig, files = page_lab.lab.describe(RIG), set(page.files.rglob("*"))
    client, statuses, previews, number = fresh(page), [], 0, 0
    while number < REQUESTS:
        body = malformed(random_one, sound)
        if random_one.random() < 0.7:
            body = json.dumps(damaged(random_one, sound)).encode("utf-8", "surrogatepass")
        if previewed := is_previewed(page, body, rig):
            if previews == MOST_PREVIEWS:
                continue
            previews += 1
        if number % 40 == 0:
            client = fresh(page)
        number += 1
        headers = {
            "Content-Type": "application/json",
            "X-Duralab-Page": client.version,
            "X-Duralab-Token": client.token,
            "Cookie": f"duralab_session={client.cookie}",
        }
        status, content = raw(client, "POST", "/api/target_preview", body, headers)
        statuses.append(status)
        assert status < 500, (body[:300], content)
        if status >= 400:
            assert json.loads(content)["error"].endswith((".", "?", "!")), (body[:300], content)
        else:
            assert previewed, (body, content[:300])
    assert previews == MOST_PREVIEWS
    assert set(page.files.rglob("*")) == files
    assert statuses.count(400) > REQUESTS // 2


@pytest.mark.parametrize("path", READS)
def test_no_malformed_question_about_a_campaign_fails(nothing_moves, page, path):
    random_one = random.Random(path)
    client = fresh(page)
    for number in range(REQUESTS):
        if number % 80 == 0:
            client = fresh(page)
        parts = path.split("/")
        parts[random_one.randrange(2, len(parts))] = random_one.choice(
            ["%00", "..", "%2e", "*", "a%20b", "@head", "x" * 500, "held%2f..", "ENDED", "ended.", "held-2"]
        )
        query = random_one.choice(["", "?id=ended", "?id=%ff&id=ended", "?id=held&id=" + "a" * 4000, "?&&=;"])
        cookie = {"Cookie": f"duralab_session={client.cookie}"}
        status, content = raw(client, "GET", "/".join(parts) + query, b"", cookie)
        assert status < 500, (path, parts, query, status, content)


def test_malformed_stops_of_a_waiting_campaign_stop_at_most(page_lab, page):
    random_one, before = random.Random("stop"), playbacks(page_lab)
    client = fresh(page)
    for _ in range(REQUESTS):
        headers = {
            "Content-Type": "application/json",
            "X-Duralab-Page": client.version,
            "X-Duralab-Token": client.token,
            "Cookie": f"duralab_session={client.cookie}",
        }
        body = malformed(random_one, {"reason": "x"})
        status, content = raw(client, "POST", "/api/campaigns/held/stop", body, headers)
        assert status < 500, (status, body[:300], content)
    assert playbacks(page_lab) == before
    assert page_lab.lab.state(RIG).run == ""
    assert not [line for line in page.log if line.get("level") == "error"]
