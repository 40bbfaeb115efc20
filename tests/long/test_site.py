"""The documentation's site: it builds without a warning, opens without a network, and no link in it leads nowhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import unquote

import pytest
from browser import Browser, browser_program

ROOT = Path(__file__).resolve().parents[2]
LOADED = {("script", "src"), ("link", "href"), ("img", "src"), ("iframe", "src"), ("source", "src"), ("video", "src")}
ELSEWHERE = re.compile(r"(https?:)?//")
#: Part of the theme, said in a comment or for search engines; nothing is loaded from there.
NOT_LOADED = {"canonical"}
SEARCH_SECONDS = 120.0


@dataclass
class Page(HTMLParser):
    """What a page loads, where it links to, and what can be linked to in it."""

    loaded: set[str] = field(default_factory=set)
    links: set[str] = field(default_factory=set)
    anchors: set[str] = field(default_factory=set)
    equations: int = 0

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = {name: value or "" for name, value in attrs}
        self.loaded |= {told[name] for kind, name in LOADED if tag == kind and told.get(name)} - (
            {told.get("href", "")} if told.get("rel") in NOT_LOADED else set()
        )
        self.anchors |= {told[name] for name in ("id", "name") if name in told}
        self.equations += tag == "math"
        if tag == "a" and "href" in told:
            self.links.add(told["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make docs` builds it."""
    folder = tmp_path_factory.mktemp("site")
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=170,
    )
    assert built.returncode == 0, built.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    """Every page of it, parsed."""
    parsed = {}
    for path in sorted(site.rglob("*.html")):
        parsed[path] = Page()
        parsed[path].feed(path.read_text(encoding="utf-8"))
    return parsed


def test_nothing_is_loaded_from_elsewhere(site: Path, pages: dict[Path, Page]):
    loaded = {(str(path.relative_to(site)), url) for path, page in pages.items() for url in page.loaded}
    assert {(name, url) for name, url in loaded if ELSEWHERE.match(url)} == set()
    styles = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert [url for style in styles for url in re.findall(r"(?:@import|url\()\s*['\"]?(https?:[^'\")]+)", style)] == []


def test_every_link_leads_to_a_page_and_a_place_that_are_there(site: Path, pages: dict[Path, Page]):
    broken = []
    for path, page in pages.items():
        # The page that says that a page is missing is shown at any address.
        if path.name == "404.html":
            continue
        for link in page.links:
            if ELSEWHERE.match(link) or link.startswith(("mailto:", "javascript:")):
                continue
            target, _, anchor = unquote(link).partition("#")
            found = (path.parent / target).resolve() if target else path
            if found.is_dir():
                found /= "index.html"
            if not found.is_file() or (anchor and found in pages and anchor not in pages[found].anchors):
                broken.append(f"{path.relative_to(site)}: {link}")
    assert broken == []


def test_equations_are_drawn_by_the_browser_itself(site: Path, pages: dict[Path, Page]):
    assert pages[site / "theory" / "iteration.html"].equations >= 10
    for path, page in pages.items():
        if path.parent.name == "theory":
            text = path.read_text(encoding="utf-8")
            assert "arithmatex" not in text, path.name
            assert page.equations == text.count("</math>")


@pytest.mark.parametrize(
    ("page", "expected"),
    [
        ("reference/python.html", ["duralab.Lab", "duralab.start", "duralab.formats.read_signals"]),
        ("reference/commands.html", ["duralab-run", "duralab-doctor", "duralab-check-rig"]),
        ("reference/campaign-file.html", ["target", "stopcriteria", "updatekind"]),
        ("reference/messages.html", ["RigDescription", "SignalBlock", "RigMode"]),
        ("source/services/iterator/iterator/updates/basic_twr.py.html", ["next_drive"]),
    ],
)
def test_the_reference_is_made_from_the_code(site: Path, pages: dict[Path, Page], page: str, expected: list[str]):
    assert set(expected) <= pages[site / page].anchors


@pytest.fixture
def served(site: Path) -> Iterator[str]:
    """The site, served on this machine alone."""
    handler = partial(SimpleHTTPRequestHandler, directory=str(site))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}/index.html"
        server.shutdown()
        thread.join()


@pytest.mark.skipif(browser_program() is None, reason="needs Chromium")
@pytest.mark.timeout(300)
def test_search_works_without_a_network(served: str, tmp_path: Path):
    program = browser_program()
    assert program is not None
    with Browser(program, tmp_path) as browser:

        def value(expression: str) -> Any:
            answer = browser.call("Runtime.evaluate", expression=expression, returnByValue=True)
            return answer["result"].get("value")

        def wait_for(expression: str) -> Any:
            until = time.monotonic() + SEARCH_SECONDS
            while not (found := value(expression)):
                assert time.monotonic() < until, expression
                time.sleep(0.1)
            return found

        # Every name but this machine's leads nowhere, as without a network.
        browser.call("Network.enable")
        browser.call("Network.setBlockedURLs", urls=["https://*", "http://*.*.com/*", "*://*.org/*", "*://*.io/*"])
        browser.call("Page.navigate", url=served)
        wait_for("document.readyState == 'complete' && !!document.querySelector('[data-md-component=search-query]')")
        value("document.querySelector('#__search').checked = true")
        value("document.querySelector('[data-md-component=search-query]').focus()")
        browser.call("Input.insertText", text="hold point")
        links = (
            "[...document.querySelectorAll('.md-search-result__link')].map(link => link.getAttribute('href')).join(' ')"
        )
        assert "iteration.html" in wait_for(links)
