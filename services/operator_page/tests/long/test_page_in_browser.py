"""The page in a real browser: a campaign begun, held, changed, stopped and resumed, by mouse and by keyboard."""

import io
import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from browser import Browser, browser_program
from page_in_browser import IN_A_BROWSER, Page, decide
from page_lab import PASSWORDS, RIG, Client, PageProcess, campaign, schedule, write_target
from PIL import Image

import duralab
from duralab.processes import Viewer

HERE = Path(__file__).parent
SHIPPED = Path(duralab.__file__).with_name("campaign") / "shipped" / "front_axle_demo.yaml"

pytestmark = IN_A_BROWSER


def test_a_campaign_is_begun_held_changed_decided_stopped_and_resumed(lab, served, browser):
    lab.put_campaign(served, campaign("held", real_time=True))
    page = Page(browser, served.address)
    page.go("run")
    page.choose("select[name=campaign]", "file:held")
    page.deliberate("section[aria-label='Begin a campaign']")
    page.wait_for_text("The campaign held has begun.", ".said")
    decide(page, 1)
    page.deliberate(".hold")
    decide(page, 2, "change", reason="too slow")
    page.write(".hold input[name=gain]", "0.8")
    page.deliberate(".hold")
    decide(page, 3)
    page.deliberate(".hold")
    page.wait_for_text("held.i02")
    page.wait("document.querySelectorAll('.figures tbody tr').length === 2")
    decide(page, 4, "back", reason="look again")
    page.write(".hold input[name=from]", "1")
    page.deliberate(".hold")
    decide(page, 5)
    page.deliberate(".hold")
    page.wait_for_text("playing", "h1 .mode")
    page.click("#stop")
    page.wait_for_text("interlocked", "h1 .mode")
    page.wait_for_text("Stopped", ".activity")
    assert lab.lab.state(RIG).reason == "Stop (local operator, at the operator page)"
    page.go("rig")
    page.write("article input", "the stop was a test")
    page.deliberate("article:nth-of-type(3)")
    page.wait_for_text("idle", ".large")
    page.go("run")
    page.deliberate(".resume")
    page.wait_for_text("Run held-2", "h1")
    decide(page, 1, "end", reason="enough")
    page.deliberate(".hold")
    page.wait("document.querySelector('.activity') && !document.querySelector('.hold')")
    assert page.value("wrong") == []
    (entry,) = [found for found in lab.lab.catalogue.search() if found.id == "held"]
    assert entry.result == "stopped"
    recording = duralab.open(lab.lab.catalogue.fetch("held", lab.folder / "fetched"))
    assert [(each.kind.value, each.name) for each in recording.decisions] == [
        (kind, "local operator") for kind in ("play", "change", "play", "back", "play")
    ]
    assert np.frombuffer(recording.specification_in_use.update.iteration_gain.data).tolist() == [0.8, 0.8]
    assert recording.specification.scenario.startswith("# Begun at the operator page by local operator.\n")


def test_a_test_is_set_up_from_a_measured_file_run_and_reported(lab, served, browser, tmp_path):
    page = Page(browser, served.address)
    page.go("new")
    page.choose("select[name=beginning]", f"rig:{RIG}")
    page.wait("document.querySelector('input[name=measured]')")
    written = write_target(tmp_path / "proving ground.rsp", lab.rig)
    browser.call("DOM.enable")
    root = browser.call("DOM.getDocument")["root"]["nodeId"]
    node = browser.call("DOM.querySelector", nodeId=root, selector="input[name=measured]")["nodeId"]
    browser.call("DOM.setFileInputFiles", nodeId=node, files=[str(written)])
    first = lab.rig.responses[0].name
    page.wait_for_text("2 channels, 6 s at 1000 Hz.")
    page.choose(f"select[name=map-{first}]", first)
    page.click("#preview")
    page.wait_for_text("What the steps did")
    page.wait("document.querySelectorAll('section[aria-label=Target] canvas').length === 4")
    lab.lab.pre_test(RIG, id="before-set-up", level=0.01)
    page.click("#levels")
    page.wait_for_text("The levels of the identification follow from the pulses of before-set-up.")
    page.write("#field-name", "set-up")
    page.write("#field-rig", RIG)
    for name, text in (("excitation-duration", "20"), ("excitation-rms", "0.002"), ("stop-iterations", "two")):
        page.value(f"document.getElementById('field-{name}').closest('details').open = true; 0")
        page.write(f"#field-{name}", text)
    page.wait_for_text("Give a number")
    page.write("#field-stop-iterations", "0")
    page.click("#check")
    page.wait_for_text("stop.iterations is 0", ".wrong[role=alert]")
    page.write("#field-stop-iterations", "2")
    page.click("#save")
    page.wait_for_text("It is a campaign file")
    assert duralab.load_campaign(served.files / "set-up.yaml").stop.iterations == 2
    page.go("run")
    page.choose("select[name=campaign]", "file:set-up")
    page.deliberate("section[aria-label='Begin a campaign']")
    page.wait_for_text("Run set-up", "h1")
    page.wait("document.querySelectorAll('.figures tbody tr').length === 2")
    page.wait("document.querySelector('.resume')")
    page.go("recordings")
    page.wait("document.querySelector(\"a[href='/api/recordings/set-up/report']\")")
    assert page.value("wrong") == []
    browser.call("Page.navigate", url=f"{served.address}api/recordings/set-up/report")
    page.wait("document.querySelectorAll('.plot .main-svg').length > 3")
    assert page.value("wrong.filter((one) => !one.includes('storage') && !one.includes('sandbox'))") == []


def test_the_keyboard_alone_begins_changes_decides_stops_resumes_and_opens_the_report(lab, served, browser):
    # A minute long: a browser that draws without a graphics card on a busy machine may stand still for 12 s.
    lab.put_campaign(served, campaign("typed", real_time=True), samples=60_000)
    page = Page(browser, served.address)
    page.wait_for_text("live")

    def say(field: str, words: str) -> None:
        page.tab_to(field)
        browser.call("Input.insertText", text=words)

    def decide_by_keys(proposal: int, downs: int, *, gain: str = "", reason: str) -> None:
        page.wait_for_text(f"on proposal {proposal},", ".activity")
        page.tab_to(".hold input[name=decision]")
        for _ in range(downs):
            page.key("ArrowDown", windowsVirtualKeyCode=40)
        if gain:
            say(".hold input[name=gain]", gain)
        say(".hold input[name=reason]", reason)
        page.tab_and_do(".hold .arm")

    page.key("3", text="3")
    page.wait_for_text("Begin a campaign")
    page.tab_to("select[name=campaign]")
    page.choose("select[name=campaign]", "file:typed")
    page.tab_and_do(".arm")
    decide_by_keys(1, 1, gain="0.8", reason="too slow")
    decide_by_keys(2, 0, reason="by keyboard")
    page.wait_for_text("playing", "h1 .mode")
    page.key("F9", windowsVirtualKeyCode=120)
    page.wait_for_text("interlocked", "h1 .mode")
    page.wait_for_text("Stopped", ".activity")
    page.value("document.activeElement.blur()")
    page.key("2", text="2")
    say("article input", "the stop was a test")
    page.tab_and_do("article:nth-of-type(3) .arm")
    page.wait_for_text("idle", ".large")
    page.value("document.activeElement.blur()")
    page.key("3", text="3")
    page.wait("document.querySelector('.resume .arm') && !document.querySelector('.resume .arm').disabled")
    page.tab_to(".resume .arm")
    page.key("Enter", text="\r", windowsVirtualKeyCode=13)
    page.wait("document.activeElement.className.includes('go')")
    page.key("Enter", text="\r", windowsVirtualKeyCode=13)
    page.wait_for_text("Run typed-2", "h1")
    decide_by_keys(1, 3, reason="enough")
    page.wait("document.querySelector('.resume')")
    page.value("document.activeElement.blur()")
    page.key("6", text="6")
    page.tab_to("a[href='/api/recordings/typed-2/report']")
    page.key("Enter", text="\r", windowsVirtualKeyCode=13)
    report = f"{served.address}api/recordings/typed-2/report"
    end = time.monotonic() + 60.0
    while report not in [target["url"] for target in browser.call("Target.getTargets")["targetInfos"]]:
        assert time.monotonic() < end
        time.sleep(0.1)
    recording = duralab.open(lab.lab.catalogue.fetch("typed", lab.folder / "typed"))
    assert [each.kind.value for each in recording.decisions] == ["change", "play"]
    assert np.frombuffer(recording.specification_in_use.update.iteration_gain.data).tolist() == [0.8, 0.8]


BEGIN_ENDURANCE = "section[aria-label='Begin an endurance test']"


def test_an_endurance_test_is_begun_held_gone_on_with_and_stopped(lab, served, browser):
    lab.put_schedule(served, schedule("by-mouse"))
    page = Page(browser, served.address)
    page.go("endurance")
    page.choose("select[name=schedule]", "by-mouse")
    page.wait_for_text("1800 repeats on linear")
    page.choose("select[name=pace]", "real")
    page.deliberate(BEGIN_ENDURANCE)
    page.wait_for_text("playing", "h1 .mode")
    page.wait("document.querySelectorAll('section[aria-label=Trends] canvas').length === 2")
    page.write("input[name=hold-reason]", "a look")
    page.deliberate(".acting")
    page.wait("document.querySelector('.hold')")
    page.wait_for_text("a look (local operator, at the operator page)", ".hold")
    page.write(".hold input[name=reason]", "looked")
    page.deliberate(".hold")
    page.wait("!document.querySelector('.hold')")
    page.wait_for_text("looked", "section .scroll[aria-label=Decisions], .scroll[aria-label=Decisions]")
    page.write("input[name=hold-reason]", "seen enough")
    page.deliberate(".acting .deliberate:last-child")
    page.wait_for_text(f"{RIG}: stopped, at rest.", ".said")
    page.wait_for_text("stopped", "h1 .mode")
    assert page.value("wrong") == []
    progress = lab.lab.endurance("by-mouse").progress()
    assert progress.phase == "stopped"
    assert "seen enough (local operator, at the operator page)" in progress.reason


def test_the_keyboard_alone_begins_holds_goes_on_with_and_stops_an_endurance_test(lab, served, browser):
    lab.put_schedule(served, schedule("by-keyboard"))
    page = Page(browser, served.address)
    page.wait_for_text("live")

    def say(field: str, words: str) -> None:
        page.wait(f"document.querySelector({json.dumps(field)})")
        page.value(f"document.querySelector({json.dumps(field)}).focus()")
        browser.call("Input.insertText", text=words)

    page.key("4", text="4")
    page.choose("select[name=schedule]", "by-keyboard")
    page.choose("select[name=pace]", "real")
    page.value("document.querySelector('select[name=pace]').focus()")
    page.tab_and_do(f"{BEGIN_ENDURANCE} .arm")
    say("input[name=hold-reason]", "a look")
    page.tab_and_do(".acting .arm")
    say(".hold input[name=reason]", "looked")
    page.tab_and_do(".hold .arm")
    page.wait("!document.querySelector('.hold')")
    page.wait_for_text("playing", "h1 .mode")
    page.key("F9", windowsVirtualKeyCode=120)
    page.wait_for_text("stopped", "h1 .mode")
    assert lab.lab.endurance("by-keyboard").progress().phase == "stopped"


def test_one_act_moves_nothing_and_an_armed_one_is_disarmed_by_itself(lab, served, browser):
    lab.put_campaign(served, campaign("armed"))
    lab.put_campaign(served, campaign("another"))
    page = Page(browser, served.address)
    page.go("run")
    page.choose("select[name=campaign]", "file:armed")
    page.click(".arm")
    page.wait("document.querySelector('.go')")
    page.choose("select[name=campaign]", "file:another")
    page.wait("!document.querySelector('.go')")
    page.choose("select[name=campaign]", "file:armed")
    page.click(".arm")
    page.wait("document.querySelector('.go')")
    page.wait("!document.querySelector('.go')")
    assert "armed" not in {entry.id for entry in lab.lab.catalogue.search()}


def test_a_page_that_lost_its_stream_says_so_within_3_s_and_moves_nothing(lab, served, browser):
    lab.put_campaign(served, campaign("cut"))
    page = Page(browser, served.address)
    page.go("run")
    page.choose("select[name=campaign]", "file:cut")
    page.wait("!document.querySelector('.arm').disabled")
    # Frozen: its connections stay open, and nothing comes.
    os.kill(served.process.pid, signal.SIGSTOP)
    try:
        page.wait_for_text("No contact with the lab.", seconds=3.0)
        page.wait("[...document.querySelectorAll('.arm')].every((button) => button.disabled)", 1.0)
        # A stop is tried all the same.
        assert not page.value("document.querySelector('#stop').disabled")
        time.sleep(8.0)
    finally:
        os.kill(served.process.pid, signal.SIGCONT)
    page.wait("!document.querySelector('.banner')")
    page.wait("!document.querySelector('.arm').disabled")


def test_a_service_that_is_killed_is_noticed_and_found_again_without_old_data(lab, served, browser):
    page = Page(browser, served.address)
    page.wait_for_text("live")
    client = Client(served.address)
    client.post(f"/api/rigs/{RIG}/stop", {"reason": "before the end"})
    page.wait_for_text("before the end", ".log")
    served.kill()
    page.wait_for_text("No contact with the lab.", seconds=3.0)
    lab.lab.reset(RIG)
    served.start()
    page.wait("!document.querySelector('.banner')", 20.0)
    # What the killed one knew is gone with it; the rig is what it is now.
    page.wait_for_text("idle", ".card .mode")
    page.wait("!document.querySelector('.log').innerText.includes('before the end')")


def test_a_page_that_slept_shows_nothing_that_waited_meanwhile_as_new(lab, served, browser):
    page = Page(browser, served.address)
    page.wait_for_text("live")
    # Seconds of events wait in the browser while its script does nothing, as after a sleep.
    page.value(
        "self.shown = []; new MutationObserver(() => { const status = document.querySelector('.status');"
        "if (status.querySelector('.live')) shown.push(Date.now() / 1000 - Number(status.dataset.when)); })"
        ".observe(document.body, {subtree: true, childList: true, characterData: true, attributes: true}); 0"
    )
    page.value("(() => { const end = Date.now() + 8000; while (Date.now() < end); shown.length = 0; })()")
    page.wait("shown.length > 4", 10.0)
    assert page.value("Math.max(...shown)") < 3.0


def test_a_viewer_signs_in_sees_the_rig_and_has_no_button_that_moves_it(lab, browser):
    page = Page(browser, lab.secured_page("people").address)
    page.wait("document.querySelector('input[type=password]')")
    page.write("input[autocomplete=username]", "Vera")
    page.write("input[type=password]", "a wrong one")
    page.click("form button")
    page.wait_for_text("Name or password is wrong.")
    page.write("input[type=password]", PASSWORDS["Vera"])
    page.click("form button")
    page.wait_for_text("Vera (viewer)")
    page.wait_for_text("You watch only.")
    for screen in ("lab", "rig", "run", "endurance", "new", "recordings"):
        page.go(screen)
        page.wait("document.querySelector('main h1')")
        assert page.value("document.querySelectorAll('#stop, .arm, .go').length") == 0
    page.value("[...document.querySelectorAll('header button')].find((one) => one.innerText === 'Sign out').click(); 0")
    page.wait("document.querySelector('input[type=password]')")
    assert page.value("wrong") == []


HOSTILE = "<img src=x onerror=wrong.push('run')>&amp;"


def test_a_hostile_reason_is_shown_as_text(lab, served, browser):
    page = Page(browser, served.address)
    page.wait_for_text("live")
    Client(served.address).post(f"/api/rigs/{RIG}/stop", {"reason": HOSTILE})
    page.wait_for_text(HOSTILE, ".reason")
    page.wait_for_text(HOSTILE, ".log")
    assert page.value("wrong") == []
    assert page.value("document.querySelectorAll('img').length") == 0


# Capitals of 3.4 mm on 24 inches of 1920 dots: 5.9 arc minutes from two metres.
SMALLEST_TEXT = 17.0
SMALL_TEXT = """(() => {
  const found = new Set(), walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const e = walk.currentNode.parentElement, size = parseFloat(getComputedStyle(e).fontSize);
    const shown = walk.currentNode.data.trim() && e.getClientRects().length;
    if (shown && size < %f) found.add(`${size} ${e.outerHTML.slice(0, 80)}`);
  }
  return [...found]; })()"""
FITS = "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
STOP_IS_FREE = """(() => { const r = document.querySelector('#stop').getBoundingClientRect();
return r.left >= 0 && r.right <= innerWidth && r.top >= 0 && r.bottom <= innerHeight
&& document.querySelector('#stop').contains(document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2)); })()"""


def test_every_screen_fits_each_display_with_the_stop_in_sight_and_text_that_can_be_read(lab, served, browser):
    lab.put_campaign(served, campaign("sizes"))
    client = Client(served.address)
    assert client.act("/api/campaigns", {"kind": "file", "name": "sizes"})[0] == 200
    page = Page(browser, served.address)
    page.go("run")
    page.wait("document.querySelectorAll('.hold canvas').length > 2")
    page.go("new")
    page.choose("select[name=beginning]", f"rig:{RIG}")
    page.wait("document.querySelector('input[name=measured]')")
    found = {}
    for width, height in ((1920, 1080), (1366, 768), (1180, 820), (1024, 768), (820, 1180), (390, 844)):
        page.look(width, height, "light")
        for screen in ("lab", "rig", "run", "endurance", "new", "recordings"):
            page.go(screen)
            page.wait("document.querySelector('main h1')")
            page.value("document.querySelectorAll('details').forEach((one) => { one.open = true; }); 0")
            for at in ("0", "document.body.scrollHeight"):
                page.value(f"scrollTo(0, {at}); new Promise((done) => setTimeout(done, 100))")
                if not (page.value(FITS) and page.value(STOP_IS_FREE)):
                    found[screen, width, at] = page.value("document.documentElement.scrollWidth")
            if width == 1920 and (small := page.value(SMALL_TEXT % SMALLEST_TEXT)):
                found[screen] = small
    client.post(f"/api/rigs/{RIG}/stop")
    assert found == {}


def test_the_page_is_light_and_dark_as_the_system_is_and_fits_a_tablet(served, browser):
    page = Page(browser, served.address)
    page.wait_for_text("live")
    for theme, dark in (("light", False), ("dark", True)):
        page.look(1920, 1080, theme)
        time.sleep(0.2)
        picture = np.asarray(Image.open(io.BytesIO(browser.picture())).convert("L"))
        assert (np.median(picture) < 60) == dark
    page.look(820, 1180, "light")
    assert page.value("document.documentElement.scrollWidth <= document.documentElement.clientWidth")


AXE = (HERE.parent / "vendor" / "axe.min.js").read_text()
RULES = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_no_screen_breaks_a_rule_of_accessibility(lab, served, browser, theme):
    lab.put_campaign(served, campaign("seen", hold="first"))
    client = Client(served.address)
    assert client.act("/api/campaigns", {"kind": "file", "name": "seen"})[0] == 200
    page = Page(browser, served.address, theme=theme)
    page.go("run")
    page.wait("document.querySelector('.hold table')")
    page.value(f"{AXE}; 0")
    found = {}
    for screen in page.value("[...document.querySelectorAll('nav a')].map((a) => a.hash.slice(1))"):
        page.go(screen)
        time.sleep(0.5)
        broken = page.value(
            f"axe.run(document, {json.dumps(RULES)}).then((r) => r.violations.map((v) => [v.id, v.nodes[0].html]))"
        )
        if broken:
            found[screen] = broken
    client.post(f"/api/rigs/{RIG}/stop")
    assert found == {}


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_an_endurance_test_that_waits_breaks_no_rule_of_accessibility(lab, served, browser, theme):
    name = f"seen-{theme}"
    lab.put_schedule(served, schedule(name))
    client = Client(served.address)
    assert client.act("/api/endurance", {"name": name})[0] == 200
    client.wait_for(lambda seen: any(one["read"] >= 12 for one in seen["endurance"] if one["id"] == name))
    lab.rig.cracked = True
    client.wait_for(lambda seen: any(one["hold_alarms"] for one in seen["endurance"] if one["id"] == name))
    page = Page(browser, served.address, theme=theme)
    page.go("endurance")
    page.wait("document.querySelectorAll('section[aria-label=Trends] canvas').length === 2")
    page.wait("document.querySelector('.level')")
    page.value(f"{AXE}; 0")
    broken = page.value(
        f"axe.run(document, {json.dumps(RULES)}).then((r) => r.violations.map((v) => [v.id, v.nodes[0].html]))"
    )
    client.post(f"/api/rigs/{RIG}/stop")
    assert broken == []
    client.wait_for(lambda seen: all(one["ended"] for one in seen["endurance"]))


def framed(page: Page) -> np.ndarray:
    """Return the grey picture of the frame on the Rig screen, as far as it is in view."""
    page.value("document.querySelector('iframe').scrollIntoView({block: 'end'}); 0")
    box = page.value(
        "(() => { const r = document.querySelector('iframe').getBoundingClientRect();"
        "return [r.left, Math.max(0, r.top), r.right, Math.min(innerHeight, r.bottom)]; })()"
    )
    return np.asarray(Image.open(io.BytesIO(page.browser.picture())).convert("L").crop(tuple(map(round, box))), float)


def changed_share(page: Page, before: np.ndarray) -> float:
    now = framed(page)
    return float(np.mean(np.abs(now - before) > 8.0)) if now.shape == before.shape else 1.0


def until_changed(page: Page, before: np.ndarray, share: float, seconds: float = 240.0) -> None:
    end = time.monotonic() + seconds
    while (found := changed_share(page, before)) < share:
        assert time.monotonic() < end, f"{100 * found:.2f} % of the frame changed; {100 * share:.2f} % are expected"
        time.sleep(1.0)


@pytest.mark.skipif(
    "DURALAB_DRAW_3D" not in os.environ,
    reason="without a graphics card it draws for minutes: DURALAB_DRAW_3D=1 runs it",
)
@pytest.mark.timeout(900)
def test_the_rig_is_drawn_in_three_dimensions_in_the_frame_of_a_viewer(tmp_path):
    rig = "front_axle_compliant"
    document = yaml.safe_load(SHIPPED.read_text())
    rms = dict(zip(document["excitation"]["rms"], [0.004, 0.003, 0.001] * 2, strict=True))
    document |= {"name": "drawn", "rig": rig, "hold": "first", "real_time": True}
    document["excitation"] |= {"rms": rms, "duration": 40.0}
    document["target"]["road"] |= {"duration": 12.0, "potholes": None}
    with (
        Viewer(port=0, web_port=0, native=False) as viewer,
        duralab.start(tmp_path, rigs=(rig, "predecessor"), viewer=viewer.address) as lab,
        Browser(browser_program(), tmp_path / "profile", webgl=True) as browser,
    ):
        served = PageProcess(lab.endpoints[0], tmp_path / "page", viewer=viewer.page)
        try:
            (served.files / "drawn.yaml").write_text(yaml.safe_dump(document))
            page = Page(browser, served.address)
            page.go("rig")
            page.wait("document.querySelector('iframe')")
            until_changed(page, np.full_like(framed(page), framed(page)[0, 0]), 0.01)
            welcome = framed(page)
            client = Client(served.address)
            assert client.act("/api/campaigns", {"kind": "file", "name": "drawn"})[0] == 200
            client.wait_for(lambda lab: any(one["hold"] for one in lab["campaigns"]), seconds=240.0)
            until_changed(page, welcome, 0.05)
            still = framed(page)
            # It goes on: the viewer draws what came since, late where no graphics card helps it.
            decision = {"kind": "play", "proposal": 1, "reason": "as foreseen"}
            assert client.act("/api/campaigns/drawn/decide", decision)[0] == 200
            until_changed(page, still, 0.005)
            assert page.value("wrong") == []
        finally:
            served.close()
