"""The report's page as its readers meet it: colours that can be read, names for everything, nothing from outside."""

import re
from importlib.resources import files
from itertools import pairwise

import pytest
import synthetic_campaign

from duralab.report import write_report

CSS = (files("duralab.report") / "page.css").read_text(encoding="utf-8")
LEAST_FOR_TEXT, LEAST_FOR_CURVES = 4.5, 2.5


@pytest.fixture(scope="module")
def html(recording_path, tmp_path_factory):
    return write_report(recording_path, tmp_path_factory.mktemp("page") / "report.html").read_text(encoding="utf-8")


def theme(selector):
    block = re.search(rf"^{re.escape(selector)} \{{(.*?)^\}}", CSS, re.DOTALL | re.MULTILINE)[1]
    return dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", block))


def contrast(one, other):
    """Return the contrast of two colours as WCAG 2.1 defines it, 1 to 21."""

    def luminance(color):
        shares = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in shares]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("selector", [":root", ':root[data-theme="dark"]'])
def test_texts_and_curves_stand_out_in_both_themes(selector):
    colors = theme(selector)
    for name in ("text", "muted", "accent", "good", "bad", "neutral"):
        for ground in ("page", "surface"):
            assert contrast(colors[name], colors[ground]) >= LEAST_FOR_TEXT, (name, ground)
    for name, color in colors.items():
        if name.startswith("channel-") or name in ("target", "first", "best", "last", "error"):
            assert contrast(color, colors["page"]) >= LEAST_FOR_CURVES, name
    for channel in ("target", "last", "error"):
        assert contrast(colors[channel], colors["held"]) >= LEAST_FOR_CURVES, channel


def test_every_colour_of_a_figure_is_one_of_both_themes(html):
    used = set(re.findall(r'"@([\w-]+)"', html[html.index('id="figures"') : html.rindex("<script>")]))
    for selector in (":root", ':root[data-theme="dark"]'):
        assert used <= theme(selector).keys()


def test_every_plot_has_its_figure_and_words_for_who_does_not_see_it(html):
    plots = re.findall(r'<div class="plot"[^>]*>', html)
    assert len(plots) > 20
    for plot in plots:
        kind, value = re.search(r'data-kind="([^"]*)" data-value="([^"]*)"', plot).groups()
        assert f'"{kind}-{value}":' in html or f'"{kind}":' in html, plot
        assert len(re.search(r'aria-label="([^"]*)"', plot)[1]) > 10
        assert 'role="img"' in plot


def test_tables_have_headings_and_can_be_scrolled_by_keyboard(html):
    page = html[html.index("<main>") : html.index("</main>")]
    assert page.count('<div class="scroll" tabindex="0" role="region" aria-label=') == page.count('<div class="scroll"')
    for table in re.findall(r"<table.*?</table>", page, re.DOTALL):
        assert re.search(r"<th scope=\"(?:col|colgroup)\"", table)
        assert '<th scope="row">' in table
    assert '<html lang="en">' in html
    assert re.findall(r"<h1>", html) == ["<h1>"]
    levels = [int(level) for level in re.findall(r"<h([1-6])[ >]", html[: html.index("<script>")])]
    assert all(after <= before + 1 for before, after in pairwise(levels))
    for target in re.findall(r'href="#(\w+)"', html):
        assert f'id="{target}"' in html


def test_choices_name_figures_that_are_there(html):
    for group in set(re.findall(r'data-chooses="(\w+)"', html)):
        kinds = set(re.findall(rf'data-kind="(\w+)"[^>]*data-chosen="{group}"', html))
        assert kinds, group
        select = re.search(rf'<select data-chooses="{group}">(.*?)</select>', html, re.DOTALL)
        buttons = re.findall(rf'data-chooses="{group}" value="([\d-]+)"', html)
        options = re.findall(r'<option value="([^"]*)"', select[1]) if select else buttons
        assert options
        for kind in kinds:
            for value in options:
                assert f'"{kind}-{value}":' in html, (kind, value)


def test_ten_iterations_of_a_long_target_fit_into_fifteen_megabytes(tmp_path):
    campaign = synthetic_campaign.make(seconds=60.0, iterations=10)
    path = synthetic_campaign.write(tmp_path / "r.mcap", synthetic_campaign.steps(campaign))
    assert write_report(path, tmp_path / "r.html").stat().st_size < 15_000_000
