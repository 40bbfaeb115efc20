"""Endurance tests over HTTP: forecast, begun, shown with their limits, held, decided, stopped."""

import time

import numpy as np
import pytest
from page_lab import RIG, Client, schedule


@pytest.fixture(scope="module")
def page(page_lab):
    return page_lab.secured_page("endurance")


@pytest.fixture
def people(page):
    clients = {name: Client(page.address) for name in ("Ada", "Grace", "Vera")}
    for name, client in clients.items():
        assert client.sign_in(name)[0] == 200
    yield clients
    for name in ("Ada", "Grace"):
        clients[name].post(f"/api/rigs/{RIG}/release")


def test_of(id):
    return lambda lab: next((one for one in lab["endurance"] if one["id"] == id), None)


test_of.__test__ = False


def begun(page_lab, page, ada, name, **changes):
    page_lab.put_schedule(page, schedule(name, **changes))
    status, answer = ada.act("/api/endurance", {"name": name})
    assert (status, answer["rig"], answer["test"]) == (200, RIG, name)


def test_a_schedule_is_forecast_and_is_no_campaign(page_lab, page, people):
    page_lab.put_schedule(page, schedule("counted"))
    ada, vera = people["Ada"], people["Vera"]
    assert "counted" in vera.get("/api/schedules")[1]["schedules"]
    assert "counted" not in vera.get("/api/campaign_files")[1]["files"]
    # It costs seconds and room, so that it is an operator's.
    assert vera.get("/api/schedules/counted")[0] == 403
    status, found = ada.get("/api/schedules/counted")
    assert status == 200
    assert (found["repeats"], found["seconds"]) == (1800, 1200 * 2.0 + 600 * 1.0)
    assert [event[:2] for event in found["events"]] == [["rough", 1200], ["smooth", 600]]
    assert ada.get("/api/schedules/nowhere")[0] == 404


def test_a_test_is_begun_held_gone_on_with_alarmed_and_stopped(page_lab, page, people):
    ada, grace, vera = people["Ada"], people["Grace"], people["Vera"]
    begun_at = time.time()
    begun(page_lab, page, ada, "weeks")
    seen = vera.wait_for(lambda lab: (found := test_of("weeks")(lab)) and found["read"] >= 30)
    assert test_of("weeks")(seen)["phase"] == "playing"
    assert grace.act("/api/endurance/weeks/hold", {"reason": "lunch"})[1]["field"] == "holder"
    assert ada.act("/api/endurance/weeks/hold", {"reason": "lunch"})[0] == 200
    waiting = test_of("weeks")(ada.wait_for(lambda lab: test_of("weeks")(lab)["hold"]))
    assert (waiting["phase"], waiting["hold"], waiting["hold_alarms"]) == ("holding", 1, 0)
    assert "lunch (Ada, at the operator page)" in waiting["reason"]
    # Damage is that of the target, played so often.
    for _, counted, planned, whole in waiting["damage"]:
        assert counted == pytest.approx(planned, rel=0.05)
        assert planned < whole
    details = vera.get("/api/endurance/weeks?event=rough&statistic=rms")[1]
    curves = details["curves"]
    low, high = np.array(curves["low"], float), np.array(curves["high"], float)
    assert np.nanmax(high[0]) == pytest.approx(np.nanmin(low[0]), rel=0.05)
    # The limits are those of the settings, a tenth and three tenths from the mean of the first six.
    limits = {each["name"]: each for each in curves["limits"]}
    mean = np.nanmean(high[0])
    assert limits["warning"]["high"][0] == pytest.approx(1.1 * mean, rel=0.02)
    assert limits["abort"]["low"][0] == pytest.approx(0.7 * mean, rel=0.02)
    assert details["alarms"] == []
    decision = {"kind": "continue", "hold": 1, "reason": "lunch is over"}
    assert ada.act("/api/endurance/weeks/decide", {**decision, "hold": 7})[0] == 409
    page_lab.rig.cracked = True
    try:
        assert ada.act("/api/endurance/weeks/decide", decision)[0] == 200
        waiting = test_of("weeks")(ada.wait_for(lambda lab: test_of("weeks")(lab)["hold_alarms"]))
        assert waiting["phase"] == "holding"
    finally:
        page_lab.rig.cracked = False
    ada.wait_for(lambda lab: test_of("weeks")(lab)["read"] == waiting["played"])
    details = vera.get("/api/endurance/weeks?event=rough&statistic=residual")[1]
    alarm = details["alarms"][0]
    assert alarm["level"] == "abort"
    assert alarm["channel"] == page_lab.rig.responses[0].name
    assert begun_at <= alarm["found"] <= time.time()
    assert details["decisions"][0][:1:-1] == ["lunch is over", "Ada"]
    # It is from a file: no campaign knows how to correct it, which is said, and it holds again.
    again = {"kind": "iterate_again", "hold": waiting["hold"], "reason": "try"}
    assert ada.act("/api/endurance/weeks/decide", again)[0] == 200
    waiting = test_of("weeks")(ada.wait_for(lambda lab: test_of("weeks")(lab)["hold"] > again["hold"]))
    assert "no campaign made it" in waiting["reason"]
    assert ada.act("/api/endurance/weeks/stop", {"reason": "seen enough"})[0] == 200
    ended = test_of("weeks")(ada.wait_for(lambda lab: test_of("weeks")(lab)["ended"]))
    assert ended["phase"] == "stopped"
    assert "seen enough (Ada, at the operator page)" in ended["reason"]
    assert ada.act(f"/api/rigs/{RIG}/reset", {"reason": "whole"})[0] == 200


def test_the_stop_of_a_rig_ends_its_endurance_test(page_lab, page, people):
    ada, grace = people["Ada"], people["Grace"]
    begun(page_lab, page, ada, "stopped")
    ada.wait_for(lambda lab: (found := test_of("stopped")(lab)) and found["played"] > 2)
    assert grace.post(f"/api/rigs/{RIG}/stop", {"reason": "smoke"})[0] == 200
    ended = test_of("stopped")(grace.wait_for(lambda lab: test_of("stopped")(lab)["ended"]))
    assert ended["phase"] == "stopped"
    assert ada.act(f"/api/rigs/{RIG}/reset", {"reason": "whole"})[0] == 200


def test_a_page_that_begins_later_reads_all_repeats_back(page_lab, page, people):
    ada = people["Ada"]
    begun(page_lab, page, ada, "read-back", actions={"abort": "log"})
    page_lab.rig.cracked = False
    ada.wait_for(lambda lab: (found := test_of("read-back")(lab)) and found["read"] >= 40)
    page_lab.rig.cracked = True
    try:
        ada.wait_for(lambda lab: test_of("read-back")(lab)["alarms"])
    finally:
        page_lab.rig.cracked = False
    assert ada.act("/api/endurance/read-back/hold", {"reason": "another page"})[0] == 200
    ada.wait_for(lambda lab: test_of("read-back")(lab)["hold"])
    played = test_of("read-back")(ada.lab())["played"]
    ada.wait_for(lambda lab: test_of("read-back")(lab)["read"] == played)
    later = Client(page_lab.page("later").address)
    later.wait_for(lambda lab: (found := test_of("read-back")(lab)) and found["read"] == played)
    path = "/api/endurance/read-back?event=smooth&statistic=max"
    before, after = ada.get(path)[1], later.get(path)[1]
    assert after["curves"] == before["curves"]
    # Also when an alarm was found, before this page was there.
    assert after["alarms"] == before["alarms"]
    assert after["alarms"]
    assert all(one["found"] for one in after["alarms"])
    assert later.get("/api/endurance/read-back?event=x&statistic=max")[0] == 400
    assert later.get("/api/endurance/read-back?event=smooth&statistic=x")[0] == 400
    assert ada.post(f"/api/rigs/{RIG}/stop")[0] == 200
    ada.wait_for(lambda lab: test_of("read-back")(lab)["ended"])
    assert ada.act(f"/api/rigs/{RIG}/reset", {"reason": "whole"})[0] == 200


def test_a_schedule_that_does_not_fit_is_refused_in_a_sentence(page_lab, page, people):
    ada = people["Ada"]
    document = schedule("sent")
    page_lab.put_schedule(page, document)
    status, answer = ada.post("/api/schedules", {"document": document, "save": True, "replace": True})
    assert (status, answer["repeats"]) == (200, 1800)
    assert ada.post("/api/schedules", {"document": document, "save": True})[0] == 400
    wrong = {**document, "events": {"rough": {"drive": "../../secret.drv", "repeats": 1}}}
    status, answer = ada.post("/api/schedules", {"document": wrong})
    assert (status, answer["error"]) == (
        400,
        "The drive or target is '../../secret.drv'; give a file that was put on this page.",
    )
    status, answer = ada.post("/api/schedules", {"document": {**document, "order": "backwards"}})
    assert (status, answer["field"]) == (400, "order")
    missing = {**document, "events": {"rough": {"drive": "nowhere", "repeats": 1}}}
    assert ada.post("/api/schedules", {"document": missing})[0] == 400
    assert ada.act("/api/endurance", {"name": "nowhere"})[0] == 400
