"""The pictures of the page in the documentation: each screen in each look, shown, and light to load."""

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[3] / "docs"
PICTURES = DOCS / "pictures"
PAGES = (
    DOCS / "guides" / "operator_page.md",
    DOCS / "guides" / "operator_page_tablet.md",
    DOCS / "tutorials" / "test_engineer.md",
)
MOST_BYTES = 4_000_000


def test_each_screen_is_shown_in_each_look_and_all_pictures_together_are_small():
    shown = {name for page in PAGES for name in re.findall(r"pictures/(operator_page_\w+\.webp)", page.read_text())}
    taken = {path.name for path in PICTURES.glob("operator_page_*.webp")}
    assert shown == taken
    screens = {re.sub(r"(_tablet)?(_dark)?\.webp", "", name) for name in taken}
    wanted = {f"{screen}{look}.webp" for screen in screens for look in ("", "_dark", "_tablet", "_tablet_dark")}
    assert taken == wanted
    assert sum((PICTURES / name).stat().st_size for name in taken) <= MOST_BYTES


def test_a_reader_sees_the_pictures_of_the_theme_that_the_site_has():
    for page in PAGES:
        for name, theme in re.findall(r"pictures/(operator_page_\w+\.webp)(#[\w-]*)?", page.read_text()):
            dark = name.endswith("_dark.webp")
            assert theme == ("#gh-dark-mode-only" if dark else "#gh-light-mode-only"), (page.name, name)
