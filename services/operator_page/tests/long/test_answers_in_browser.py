"""The answer line of the window that gave a command: true when it is read, also if the command fails later."""

from page_in_browser import IN_A_BROWSER, Page
from page_lab import RIG, Client, campaign

pytestmark = IN_A_BROWSER


def test_a_begin_that_fails_later_is_reported_in_its_window_and_holds_no_rig(lab, served, browser):
    lab.put_campaign(served, campaign("fails", target={"file": "broken.rsp"}))
    (served.files / "broken.rsp").write_bytes(b"no signals")
    page = Page(browser, served.address)
    page.go("run")
    page.choose("select[name=campaign]", "file:fails")
    page.value(
        "self.answers = []; new MutationObserver(() => answers.push(document.querySelector('.said').innerText))"
        ".observe(document.querySelector('.said'), {subtree: true, childList: true, characterData: true}); 0"
    )
    page.deliberate("section[aria-label='Begin a campaign']")
    page.wait_for_text("broken.rsp", ".said.bad")
    assert not page.value("answers.some((one) => one.includes('done.'))")
    assert Client(served.address).lab()["rigs"][0]["holder"] is None


def test_the_answer_of_a_stop_is_brought_up_to_date_and_removed_by_the_reset(lab, served, browser):
    page = Page(browser, served.address)
    page.wait_for_text(f"STOP {RIG}", "#stop")  # before the page knows its rig, the key stops all rigs
    page.key("F9", windowsVirtualKeyCode=120)
    page.wait_for_text(f"{RIG}: stopped, at rest.", ".said")
    page.wait_for_text("interlocked", ".card .mode")
    lab.lab.reset(RIG)
    page.wait("document.querySelector('.said').innerText.trim() === ''")
