"""A lab whose rig can crack, pages of it, and a browser."""

import pytest
from browser import Browser, browser_program
from page_lab import RIG, PageLab

import duralab


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    with PageLab(tmp_path_factory.mktemp("page_lab")) as started:
        yield started


@pytest.fixture
def browser(tmp_path):
    with Browser(browser_program(), tmp_path / "profile") as opened:
        yield opened


@pytest.fixture
def served(lab, request):
    page = lab.page(request.node.name[:40])
    yield page
    page.close()
    lab.rig.cracked = False
    if lab.lab.state(RIG).mode is duralab.RigMode.INTERLOCKED:
        lab.lab.reset(RIG)
