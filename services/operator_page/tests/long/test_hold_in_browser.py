"""A hold point in a browser: wrong numbers are refused beside their fields, answers stay in view."""

from page_in_browser import IN_A_BROWSER, Page, decide
from page_lab import RIG, Client, campaign

pytestmark = IN_A_BROWSER
IN_VIEW = """(() => { const e = document.querySelector('.said'), r = e.getBoundingClientRect();
return r.top >= 0 && r.bottom <= innerHeight
&& e.contains(document.elementFromPoint(r.x + 20, r.y + r.height / 2)); })()"""


def test_a_person_decides_on_figures_with_units_and_on_numbers_as_they_were_typed(lab, served, browser):
    lab.put_campaign(served, campaign("waits"))
    client = Client(served.address)
    assert client.act("/api/campaigns", {"kind": "file", "name": "waits"})[0] == 200
    page = Page(browser, served.address, width=1024, height=768)
    page.go("run")
    decide(page, 1, "change", reason="as typed")
    page.wait_for_text(f" {lab.rig.drives[0].unit}/s", ".hold table")
    assert " %" in page.text(".scroll[aria-label=Prediction] tbody td")
    assert " left" not in page.text(".activity")
    for field, wrong, right in (("gain", "0,5", "0.5"), ("gain", "2", "1"), ("low", "1,5", "1.5"), ("high", "x", "40")):
        page.write(f".hold input[name={field}]", wrong)
        page.wait_for_text(f'This is "{wrong}"; write a number', ".hold")
        assert page.value("document.querySelector('.hold .arm').disabled")
        page.write(f".hold input[name={field}]", right)
        page.wait("!document.querySelector('.hold .arm').disabled")
    page.click(".hold input[value=back]")
    for wrong in ("1,5", "0", "1e3"):
        page.write(".hold input[name=from]", wrong)
        page.wait_for_text(f'This is "{wrong}"; write a whole number of at least 1.', ".hold")
        assert page.value("document.querySelector('.hold .arm').disabled")
    # No such playback: the lab refuses it, and the refusal is in view wherever the page is scrolled to.
    page.write(".hold input[name=from]", "99")
    page.deliberate(".hold")
    page.wait("document.querySelector('.said.bad')")
    for at in ("0", "document.body.scrollHeight"):
        page.value(f"scrollTo(0, {at}); new Promise((done) => setTimeout(done, 100))")
        assert page.value(IN_VIEW), at
    assert page.value("wrong") == []
    client.post(f"/api/rigs/{RIG}/stop")
