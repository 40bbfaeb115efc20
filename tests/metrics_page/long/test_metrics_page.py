"""The page of metrics says what the services of a lab answer."""

from __future__ import annotations

from pathlib import Path

from ..page import PAGE, healths_of_lab, page


def test_the_page_has_every_metric_of_every_service(tmp_path: Path):
    with healths_of_lab(tmp_path) as healths:
        assert PAGE.read_text(encoding="utf-8") == page(healths), "Run `python -m tests.metrics_page.page`."
