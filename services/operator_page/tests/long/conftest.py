"""A lab whose rig can crack, pages of it, and a browser."""

import pytest
from browser import Browser, browser_program
from page_lab import RIG, PageLab

import duralab


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    with PageLab(tmp_path_factory.mktemp("page_lab")) as started:
        yield started


@pytest.fixture(scope="session")
def browser_of_all(tmp_path_factory):
    with Browser(browser_program(), tmp_path_factory.mktemp("browser") / "profile") as opened:
        yield opened


@pytest.fixture
def browser(browser_of_all):
    """One that has seen nothing yet: a new process takes a second of processor time."""
    browser_of_all.forget_everything()
    return browser_of_all


@pytest.fixture
def served(lab, request):
    page = lab.page(request.node.name[:40])
    yield page
    page.close()
    lab.rig.cracked = False
    if lab.lab.state(RIG).mode is duralab.RigMode.INTERLOCKED:
        lab.lab.reset(RIG)
