"""The rig that STOP means, in a lab of two rigs: what is armed names it, and the window follows what it begins."""

import pytest
from page_in_browser import IN_A_BROWSER, Page
from page_lab import PLANT, RIG, Client, PageLab, campaign, schedule

from duralab.testing import LinearRig

pytestmark = IN_A_BROWSER
OTHER = "other"


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    with PageLab(tmp_path_factory.mktemp("two_rigs"), LinearRig(OTHER, plant=PLANT, noise_rms=1.0)) as started:
        yield started


@pytest.fixture
def page(served, browser):
    opened = Page(browser, served.address)
    opened.wait("document.querySelectorAll('.rig-choice option').length === 2")
    return opened


def chosen(page: Page) -> str:
    return page.value("document.querySelector('.rig-choice select').value")


def test_only_campaigns_of_the_chosen_rig_are_offered_and_what_is_armed_names_its_rigs(lab, served, page):
    lab.put_campaign(served, campaign("road"))
    roadless = {"opencrg": {"path": "nowhere.crg", "duration": 4.0}, "vehicle": "predecessor", "speed": 15.0}
    lab.put_campaign(served, campaign("roadless", target=roadless))
    (served.files / "cut.yaml").write_text("name: cut")
    page.choose(".rig-choice select", OTHER)
    page.go("run")
    offered = "[...document.querySelectorAll('select[name=campaign] option:not([disabled])')].map((one) => one.value)"
    page.wait("document.querySelector('select[name=campaign]')")
    assert page.value(offered) == [""]
    page.choose(".rig-choice select", RIG)
    page.wait(f"{offered}.includes('file:road')")
    assert "file:roadless" not in page.value(offered)
    assert "roadless is unavailable. Its road nowhere.crg is missing in the folder of this page." in page.text("main")
    page.choose("select[name=campaign]", "file:road")
    page.click(".arm")
    page.wait_for_text(f"Begin road on {RIG} now", ".go")
    page.choose(".rig-choice select", OTHER)
    page.wait("!document.querySelector('.go')")
    page.go("rig")
    Client(served.address).post(f"/api/rigs/{OTHER}/stop")
    page.write("input[name=reset-reason]", "looked at it")
    page.click("article:nth-of-type(3) .arm")
    page.wait_for_text(f"Reset {OTHER} now", ".go")
    page.click(".go")
    page.wait_for_text("idle", ".large")


def test_only_schedules_of_the_chosen_rig_are_offered_and_the_key_stops_the_rig_that_begins(lab, served, page):
    lab.put_schedule(served, schedule("weeks"))
    page.choose(".rig-choice select", OTHER)
    page.go("endurance")
    offered = "[...document.querySelectorAll('select[name=schedule] option')].map((one) => one.value)"
    page.wait("document.querySelector('select[name=schedule]')")
    assert page.value(offered) == [""]
    page.choose(".rig-choice select", RIG)
    page.wait(f"{offered}.includes('weeks')")
    page.choose("select[name=schedule]", "weeks")
    page.choose("select[name=pace]", "real")
    page.click("section[aria-label='Begin an endurance test'] .arm")
    page.wait_for_text(f"Begin weeks on {RIG} now", ".go")
    page.click(".go")
    page.wait_for_text("playing", "h1 .mode")
    assert chosen(page) == RIG
    page.key("F9", windowsVirtualKeyCode=120)
    page.wait_for_text("stopped", "h1 .mode")
    assert lab.lab.state(OTHER).mode == "idle"


def test_the_forecast_is_that_of_the_schedule_chosen_last_in_whatever_order_the_answers_come(lab, served, page):
    for name, repeats in (("slow", 700), ("quick", 500)):
        made = schedule(name)
        made["events"] = {"rough": {**made["events"]["rough"], "repeats": repeats}}
        lab.put_schedule(served, made)
    page.choose(".rig-choice select", RIG)
    page.value(
        "(() => { const real = fetch; self.fetch = async (path, ...also) => { const answer = await real(path, ...also);"
        "if (path.endsWith('/slow')) { await new Promise((come) => { self.come = come; }); self.came = true; }"
        "return answer; }; })()"
    )
    page.go("endurance")
    page.choose("select[name=schedule]", "slow")
    page.wait("self.come")
    page.choose("select[name=schedule]", "quick")
    page.wait_for_text(f"500 repeats on {RIG}")
    page.value("come(); new Promise((done) => setTimeout(done, 500))")
    assert page.value("came")
    assert f"500 repeats on {RIG}" in page.text("main")
    assert "700 repeats" not in page.text("main")


def test_a_reload_or_an_absent_rig_does_not_change_the_rig_that_is_stopped(browser, page):
    for rig in (OTHER, RIG):
        page.choose(".rig-choice select", rig)
        page.wait_for_text(f"STOP {rig}", "#stop")
        browser.call("Page.reload")
        page.wait_for_text(f"STOP {rig}", "#stop")
        page.wait("document.querySelector('.live')")
        assert chosen(page) == rig
    page.value("sessionStorage.setItem('rig', 'away')")
    browser.call("Page.reload")
    page.wait_for_text("away (not in the lab)", ".rig-choice")
    page.wait("document.querySelector('.live')")
    page.key("F9", windowsVirtualKeyCode=120)
    page.wait_for_text("Use the emergency stop.", ".said.bad")
    assert page.text("#stop").startswith("STOP away")


def test_a_file_that_needs_another_rig_than_the_page_showed_is_not_begun(lab, served):
    lab.put_campaign(served, campaign("road"))
    lab.put_schedule(served, schedule("weeks"))
    client = Client(served.address)
    assert client.get("/api/campaign_files")[1]["rigs"]["file:road"] == [RIG]
    for path, values in (("/api/campaigns", {"kind": "file", "name": "road"}), ("/api/endurance", {"name": "weeks"})):
        status, answer = client.act(path, {**values, "rigs": [OTHER]})
        assert (status, answer["field"]) == (400, "rigs")
        assert answer["error"] == f"The file was changed: it needs {RIG}, not {OTHER}; choose it again."
