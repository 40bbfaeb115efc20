"""The screen Endurance in a real browser: a drive corrected, a sequencer that was killed, the screen printed."""

import base64
import io
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import yaml
from page_in_browser import IN_A_BROWSER, Page
from page_lab import RIG, Client, PageLab, PageProcess, campaign, schedule
from PIL import Image
from printed_pages import printed_pages

pytestmark = IN_A_BROWSER


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    page = PageProcess("", tmp_path_factory.mktemp("alone"), bus={"listen": ["tcp/127.0.0.1:0"]})
    yield page
    page.close()


def begun(lab, served, name, **changes) -> Client:
    """Begin an endurance test as fast as the rig plays, and wait until its baselines are learnt."""
    lab.put_schedule(served, schedule(name, **changes))
    client = Client(served.address)
    assert client.act("/api/endurance", {"name": name})[0] == 200
    client.wait_for(lambda seen: any(one["read"] >= 20 for one in seen["endurance"] if one["id"] == name))
    return client


def decide(page: Page, kind: str, reason: str) -> None:
    page.click(f".hold input[value={kind}]")
    page.write(".hold input[name=reason]", reason)
    page.deliberate(".hold")


def played(page: Page) -> int:
    return page.value("Number(document.querySelector('.activity strong').innerText)")


def test_a_drive_is_corrected_after_an_alarm_and_the_test_continues_with_it(lab, served, browser):
    lab.put_campaign(served, campaign("made", hold="never", stop={"iterations": 2}))
    client = Client(served.address)
    assert client.act("/api/campaigns", {"kind": "file", "name": "made"})[0] == 200
    client.wait_for(lambda seen: any(one["ended"] for one in seen["campaigns"] if one["id"] == "made"))
    # Its drive is a campaign's: that campaign has the model by which it is corrected.
    event = {"drive": "made", "repeats": 1200, "missed_target_accepted": True}
    begun(lab, served, "corrected", events={"made": event})
    page = Page(browser, served.address)
    page.go("endurance")
    lab.rig.cracked = True
    page.wait_for_text("because of an alarm", ".hold h2")
    held_after = played(page)
    decide(page, "iterate_again", "the bracket is softer now")
    page.wait_for_text("iterating", "h1 .mode")
    page.wait_for_text("playing", "h1 .mode")
    page.wait(f"Number(document.querySelector('.activity strong').innerText) > {held_after + 5}")
    page.wait_for_text("iterate again", ".scroll[aria-label=Decisions]")
    # The correction is a campaign with a recording, and the repeats after it are played with its drive.
    page.wait_for_text("the bracket is softer now", ".scroll[aria-label=Decisions]")
    page.go("recordings")
    page.wait_for_text("corrected", "table")
    assert page.value("wrong") == []
    progress = lab.lab.endurance("corrected").progress()
    assert progress.phase == "playing"
    assert page.value("[...document.querySelectorAll('tbody th')].some((e) => /corrected-/.test(e.innerText))")
    client.post(f"/api/rigs/{RIG}/stop")
    client.wait_for(lambda seen: all(one["ended"] for one in seen["endurance"]))


def test_a_test_whose_sequencer_was_killed_is_shown_as_silent_and_continued(tmp_path, browser):
    with PageLab(tmp_path) as lab:
        served = lab.page("page")
        begun(lab, served, "broken-off")
        page = Page(browser, served.address)
        page.go("endurance")
        page.wait_for_text("playing", "h1 .mode")
        os.kill(lab.lab.process_ids["sequencer"], signal.SIGKILL)
        page.wait_for_text("no word for", "h1 .mode")
        page.wait_for_text("what stands here is old", ".notice")
        before = played(page)
        config = tmp_path / "sequencer.yaml"
        held = str(tmp_path / "lab" / "recordings" / "held")
        bus = {"connect": [lab.lab.endpoints[0]]}
        config.write_text(yaml.safe_dump({"bus": bus, "exit_with_parent": True, "held_folder": held}))
        command = [sys.executable, "-m", "sequencer", "--config", str(config)]
        with subprocess.Popen(command, stdin=subprocess.PIPE) as again:
            try:
                page.wait_for_text("broken-off", ".broken")
                client = Client(served.address)
                client.wait_for(lambda seen: any(one["service"] == "sequencer" for one in running(seen)))
                if client.lab()["rigs"][0]["mode"] == "interlocked":
                    assert client.act(f"/api/rigs/{RIG}/reset", {"reason": "looked at the rig"})[0] == 200
                page.deliberate(".broken")
                page.wait_for_text("playing", "h1 .mode")
                page.wait(f"Number(document.querySelector('.activity strong').innerText) > {before + 5}")
                page.wait("!document.querySelector('.broken')")
                assert page.value("wrong") == []
                client.post(f"/api/rigs/{RIG}/stop")
                page.wait_for_text("stopped", "h1 .mode")
            finally:
                again.terminate()


def running(seen: dict) -> list[dict]:
    return [one for one in seen["services"] if not one["trouble"]]


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_screen_is_printed_whole_black_on_white_and_without_buttons(lab, served, browser, theme):
    name = f"printed-{theme}"
    client = begun(lab, served, name)
    lab.rig.cracked = True
    page = Page(browser, served.address, theme=theme)
    page.go("endurance")
    page.wait_for_text("because of an alarm", ".hold h2")
    page.wait("document.querySelector('.level')")
    page.wait("document.querySelectorAll('section[aria-label=Trends] canvas').length === 2")
    repeats = played(page)
    browser.call(
        "Emulation.setEmulatedMedia", media="print", features=[{"name": "prefers-color-scheme", "value": theme}]
    )
    assert page.value("getComputedStyle(document.querySelector('.activity')).color") == "rgb(26, 32, 39)"
    # Plots that were drawn light on dark are inverted, others are not.
    assert page.value(
        "[...document.querySelectorAll('.plot [data-ink]')].every((one) => (one.dataset.ink === '#e6eaee')"
        " === (getComputedStyle(one.querySelector('canvas')).filter !== 'none'))"
    )
    grey = np.asarray(Image.open(io.BytesIO(browser.picture())).convert("L"))
    assert np.median(grey) == 255
    pdf = base64.b64decode(browser.call("Page.printToPDF", printBackground=True)["data"])
    pages = printed_pages(pdf)
    client.post(f"/api/rigs/{RIG}/stop")
    client.wait_for(lambda seen: all(one["ended"] for one in seen["endurance"]))
    assert 1 <= len(pages) <= 5
    text = "".join(pages)
    shown = [f"Endurance {name}", f"{repeats} of 1800 repeats", "Damage against plan", "Trends", "because of an alarm"]
    shown += ["Alarms:", "abort", lab.rig.responses[0].name, "What was kept", "Event log"]
    assert [words for words in shown if words.replace(" ", "") not in text] == []
    # Nothing that is only of use on a screen.
    useless = [
        "STOP",
        "key F9",
        "Arm:",
        "Disarm",
        "Sign out",
        "New test",
        "Recordings",
        "Reason, kept",
        "Dark",
        "Light",
    ]
    assert [words for words in useless if words.replace(" ", "") in text] == []


# Delays the answer about one schedule.
@pytest.mark.parametrize("screen", ["rig", "run", "endurance"])
def test_a_page_that_hears_no_rig_says_so_and_offers_nothing_to_begin(alone, browser, screen):
    page = Page(browser, alone.address)
    page.value("sessionStorage.removeItem('rig')")
    browser.call("Page.reload")
    page.go(screen)
    page.wait_for_text("There is no rig in this lab.", ".notice")
    page.wait("document.querySelector('.live')")
    assert page.value("document.querySelector('main select, main .go')") is None


LATE = """(() => {
  const ask = window.fetch;
  window.fetch = async (path, ...more) => {
    const answer = await ask(path, ...more);
    if (!String(path).endsWith("/api/schedules/late")) return answer;
    await new Promise((go) => setTimeout(go, 6000));
    window.lateCame = true;
    return answer;
  };
})()"""


def test_the_forecast_is_that_of_the_schedule_chosen_last_and_schedules_are_those_of_the_rig(tmp_path, browser):
    with PageLab(tmp_path) as lab:
        served = lab.page("page")
        events = schedule()["events"]
        lab.put_schedule(served, schedule("late"))
        lab.put_schedule(served, schedule("soon", events={"rough": events["rough"] | {"repeats": 7}}))
        lab.put_schedule(served, schedule("elsewhere", rig="another_rig"))
        page = Page(browser, served.address)
        page.go("endurance")
        page.wait("document.querySelector('select[name=schedule]') !== null")
        offered = page.value("[...document.querySelectorAll('select[name=schedule] option')].map((one) => one.value)")
        assert offered == ["", "late", "soon"]
        page.value(LATE)
        page.choose("select[name=schedule]", "late")
        page.choose("select[name=schedule]", "soon")
        page.wait_for_text(f"7 repeats on {RIG}")
        page.wait("window.lateCame === true")
        page.value("new Promise((go) => setTimeout(go, 500))")
        page.wait_for_text("Begin soon on")
        assert f"7 repeats on {RIG}" in page.text()
        assert "1800 repeats" not in page.text()
        assert page.value("wrong") == []
