"""The report in a real browser: offline, light and dark, wide and narrow, by keyboard, and on paper."""

import io
import json
import re
import shutil
import time

import numpy as np
import pytest
import synthetic_campaign
from browser import Browser, browser_program
from PIL import Image

import duralab
from duralab.cli.commands.report import report
from duralab.errors import InputError, LabError
from duralab.report import find_browser, write_comparison, write_pdf, write_report

SECONDS = 180.0

pytestmark = pytest.mark.skipif(browser_program() is None, reason="no chromium here; apt-get install chromium")


@pytest.fixture(scope="module")
def pages(recording_path, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    comparison = duralab.compare(recording_path, recording_path)
    return [write_report(recording_path, folder / "r.html"), write_comparison(folder / "c.html", comparison)]


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(browser_program(), tmp_path_factory.mktemp("profile")) as started:
        yield started


def value_of(browser, expression):
    answer = browser.call("Runtime.evaluate", expression=expression, returnByValue=True)
    assert "exceptionDetails" not in answer, answer
    return answer["result"].get("value")


def wait_for(browser, expression):
    deadline = time.monotonic() + SECONDS
    while not value_of(browser, expression):
        assert time.monotonic() < deadline, f"{expression} did not come true"
        time.sleep(0.2)


def open_page(browser, path, *, width, theme):
    features = [{"name": "prefers-color-scheme", "value": theme}]
    browser.call("Emulation.setEmulatedMedia", features=features)
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.call("Emulation.setDeviceMetricsOverride", **size)
    # What goes wrong in the page, and what it asks of the outside, is kept from its very first line on.
    script = """
        window.wrong = [];
        addEventListener("error", (event) => wrong.push(String(event.message)), true);
        addEventListener("unhandledrejection", (event) => wrong.push(String(event.reason)));
        addEventListener("securitypolicyviolation", (event) => wrong.push(event.blockedURI));
    """
    browser.call("Page.enable")
    kept = browser.call("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
    browser.call("Page.navigate", url="about:blank")
    browser.call("Page.navigate", url=path.as_uri())
    wait_for(browser, "document.documentElement?.dataset.drawn === 'yes'")
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=kept)


@pytest.mark.parametrize(("width", "theme"), [(1280, "light"), (1280, "dark"), (390, "light"), (320, "dark")])
def test_it_is_drawn_without_a_fault_without_the_net_and_without_sideways_scrolling(browser, pages, width, theme):
    for page in pages:
        open_page(browser, page, width=width, theme=theme)
        assert value_of(browser, "wrong") == []
        assert value_of(browser, "performance.getEntriesByType('resource').map((entry) => entry.name)") == []
        assert value_of(browser, "document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        assert value_of(browser, "[...document.querySelectorAll('.plot')].every((p) => p.querySelector('.main-svg'))")
        assert value_of(browser, "document.documentElement.dataset.theme") == theme
        picture = np.asarray(Image.open(io.BytesIO(browser.picture())).convert("L"))
        assert (np.median(picture) < 60) == (theme == "dark")


HOSTILE = "<!--<script>&amp;</script><b>\u2028"


def test_a_channel_of_any_name_takes_no_figure_away(browser, tmp_path, monkeypatch):
    """After "<!--" and "<script" in a string of JSON, the end tag of its element does not end it."""
    monkeypatch.setattr(synthetic_campaign, "NAMES", (HOSTILE + "_vertical", *synthetic_campaign.NAMES[1:]))
    path, _ = synthetic_campaign.recording(tmp_path / "r.mcap", seconds=4.0)
    comparison = duralab.compare(path, path)
    for page in (write_report(path, tmp_path / "r.html"), write_comparison(tmp_path / "c.html", comparison)):
        open_page(browser, page, width=1280, theme="light")
        assert value_of(browser, "wrong") == []
        assert value_of(browser, "[...document.querySelectorAll('.plot')].every((p) => p.querySelector('.main-svg'))")
        figures = value_of(browser, "document.getElementById('figures').textContent")
        assert not set(figures) & set("<>&\u2028\u2029")
        assert HOSTILE in json.dumps(json.loads(figures), ensure_ascii=False)
        assert HOSTILE in value_of(browser, "document.querySelector('main').textContent")


def test_the_keyboard_zooms_chooses_and_changes_the_theme(browser, pages):
    open_page(browser, pages[0], width=1280, theme="light")
    span = "(() => { const r = document.querySelector('[data-kind=wave]').layout.xaxis.range; return r[1] - r[0]; })()"
    whole = value_of(browser, span)
    value_of(browser, "document.querySelector('[data-kind=wave]').focus()")
    for key in ("+", "+", "ArrowRight"):
        browser.call("Input.dispatchKeyEvent", type="keyDown", key=key, text=key if key == "+" else "")
        browser.call("Input.dispatchKeyEvent", type="keyUp", key=key)
    wait_for(browser, f"Math.abs({span} / {whole} - 0.25) < 0.01")
    title = "document.querySelector('[data-kind=wave]').layout.yaxis.title.text"
    before = value_of(browser, title)
    choose = "document.querySelector('select[data-chooses=wave]')"
    value_of(browser, f"{choose}.value = '1'; {choose}.dispatchEvent(new Event('change'))")
    wait_for(browser, f"{title} !== {before!r}")
    value_of(browser, "document.getElementById('theme').focus()")
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="Enter", text="\r")
    wait_for(browser, "document.documentElement.dataset.theme === 'dark'")
    assert value_of(browser, "wrong") == []


def test_it_is_printed_on_a_few_sheets_of_a4_with_every_figure(recording_path, tmp_path):
    path = write_pdf(recording_path, tmp_path / "report.pdf")
    content = path.read_bytes()
    assert content.startswith(b"%PDF-")
    sheets = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", content)
    assert 5 <= len(sheets) <= 12
    for width, height in sheets:
        assert (float(width), float(height)) == (pytest.approx(595, abs=2), pytest.approx(842, abs=2))
    assert list(tmp_path.iterdir()) == [path]


def test_the_command_prints_beside_the_page_and_overwrites_nothing_unasked(recording_path, tmp_path, capsys):
    page, pdf = tmp_path / "r.html", tmp_path / "r.pdf"
    pdf.write_text("mine")
    with pytest.raises(InputError, match="would be overwritten"):
        report(recording_path, out=page, pdf=pdf, replace=False, as_json=False)
    assert (pdf.read_text(), page.exists()) == ("mine", False)
    report(recording_path, out=page, pdf=pdf, replace=True, as_json=True)
    assert pdf.read_bytes().startswith(b"%PDF-")
    assert json.loads(capsys.readouterr().out)["pdf"] == str(pdf)


def test_where_no_browser_prints_it_is_told(recording_path, tmp_path, monkeypatch):
    with pytest.raises(LabError, match="printed nothing"):
        write_pdf(recording_path, tmp_path / "r.pdf", browser=shutil.which("true"))
    with pytest.raises(LabError, match="cannot be started"):
        write_pdf(recording_path, tmp_path / "r.pdf", browser=str(tmp_path / "nowhere"))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_browser() is None
    with pytest.raises(LabError, match="No browser"):
        write_pdf(recording_path, tmp_path / "r.pdf")
    assert list(tmp_path.iterdir()) == []
