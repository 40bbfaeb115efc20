"""How results look: text that fits on a line, and HTML that parses, escapes and needs no network."""

import dataclasses
import re
from datetime import UTC, datetime
from xml.etree import ElementTree

import numpy as np
import pytest
import synthetic_campaign

import duralab
from duralab.data import (
    ActuatorUse,
    Channel,
    Convergence,
    ExperimentPlan,
    IterationTable,
    LevelAdvice,
    Played,
    Rig,
    Rigs,
    Signals,
)
from duralab.display import Axis, Curve, html_table, line_chart, text_table, to_html
from duralab.lab import CatalogueEntries, CatalogueEntry, Result
from duralab.report.actuator_rows import actuator_rows

RIG = Rig.from_message(synthetic_campaign.description("front_axle"))
NASTY = "<b>&\"'</b>"
SIGNALS = Signals((Channel(NASTY, "N"), Channel("b", "m")), 100.0, np.array([[3.0, -4.0], [0.0, 0.0]]))
PLAYED = Played("mine", SIGNALS, (ActuatorUse("a", 0.5, 0.0, 1e-3),), 12.0)
FREQUENCY = np.linspace(0.5, 40.0, 80)
CONVERGENCE = Convergence(FREQUENCY, 0.01 * FREQUENCY, 0.02 * FREQUENCY, 0.0 * FREQUENCY, 1.0, "It converges.")
ENTRY = CatalogueEntry(
    "demo", "front_axle", NASTY, datetime(2026, 1, 2, tzinfo=UTC), Result.REACHED, True, 9, 9, 0, ("a.mcap",), 10**6, ""
)


def parsed(html: str) -> ElementTree.Element:
    return ElementTree.fromstring(f"<div>{html}</div>")


@pytest.fixture(scope="module")
def recording(recording_path):
    return duralab.open(recording_path)


@pytest.fixture(scope="module")
def shown(recording):
    return {
        "rig": RIG,
        "rigs": Rigs([RIG, RIG]),
        "no rigs": Rigs(),
        "signals": SIGNALS,
        "empty signals": Signals(SIGNALS.channels, 100.0, np.zeros((2, 0))),
        "many signals": Signals(tuple(Channel(f"c{i}", "N") for i in range(20)), 10.0, np.ones((20, 3))),
        "played": PLAYED,
        "playback": recording.playback(1),
        "model": recording.model,
        "iterations": recording.iterations,
        "no iterations": IterationTable.from_messages([]),
        "recording": recording,
        "convergence": CONVERGENCE,
        "catalogue": CatalogueEntries([ENTRY]),
        "empty catalogue": CatalogueEntries(),
    }


def test_everything_a_notebook_shows_parses_and_fetches_nothing(shown):
    for name, result in shown.items():
        html = result._repr_html_()
        parsed(html)
        assert NASTY not in html, name
        assert not re.findall(r"(?:src|href)=|url\(|<script", html), name
        assert len(html) < 400_000, name


def test_everything_prints_as_a_table_and_is_told_on_one_line(shown):
    for name, result in shown.items():
        assert str(result), name
        assert "array(" not in repr(result) + str(result), name
        if not isinstance(result, tuple):
            assert "\n" not in repr(result), name


def test_figures_of_signals_are_those_of_numpy():
    row = next(line for line in str(SIGNALS).splitlines() if line.startswith(NASTY))
    assert row.split()[1:] == ["N", "-4", "3", f"{np.sqrt(12.5):.4g}"]
    rows = parsed(SIGNALS._repr_html_()).findall(".//tbody/tr")
    assert [cell.text for cell in rows[0]] == [NASTY, "N", "-4", "3", f"{np.sqrt(12.5):.4g}"]


def test_plans_and_advice_print_as_tables():
    plan = ExperimentPlan(75.0, 2, 6, 2, 0.34, 12.0, 0.49, 92, (0.4, 45.0))
    assert "0.4 to 45 Hz, 92 lines" in str(plan)
    advice = LevelAdvice(np.array([1.0]), np.array([2.0]), np.array([1.5]), None, 0.0, ("Drive 1 is at its limit.",))
    assert str(advice).splitlines()[-1] == "- Drive 1 is at its limit."


def test_columns_of_a_text_table_line_up():
    lines = text_table(("name", "value"), [("a", "1"), ("long name", "22")], left=1).splitlines()
    assert lines == ["name       value", "a              1", "long name     22"]
    assert parsed(html_table(("a",), [(NASTY,)], caption=NASTY)).find(".//td").text == NASTY


def points(svg: str) -> np.ndarray:
    line = parsed(svg).find(".//{http://www.w3.org/2000/svg}polyline")
    assert line is not None
    return np.array([[float(value) for value in point.split(",")] for point in line.attrib["points"].split()])


@pytest.mark.parametrize("logarithmic", [False, True])
def test_a_curve_is_drawn_where_it_is(logarithmic):
    x = np.array([1.0, 10.0, 100.0])
    drawn = points(line_chart([Curve("", x, x)], x=Axis("x", logarithmic), y=Axis("y", logarithmic), height=200))
    share = np.log10(x) / 2 if logarithmic else (x - 1.0) / 99.0
    np.testing.assert_allclose((drawn[:, 0] - drawn[0, 0]) / (drawn[-1, 0] - drawn[0, 0]), share, atol=1e-3)
    np.testing.assert_allclose((drawn[:, 1] - drawn[0, 1]) / (drawn[-1, 1] - drawn[0, 1]), share, atol=2e-3)
    assert drawn[-1, 1] < drawn[0, 1]


def test_a_long_curve_keeps_its_peak_and_few_points():
    y = np.zeros(1_000_000)
    y[654_321] = 7.0
    drawn = points(line_chart([Curve("", np.arange(y.size) / 1e3, y)], x=Axis("t"), y=Axis("y")))
    assert len(drawn) < 2000
    assert drawn[:, 1].min() == pytest.approx(22.0, abs=0.1)


def test_what_cannot_be_drawn_is_left_out_and_nothing_at_all_is_said():
    y = np.array([1.0, np.nan, -1.0, 10.0])
    assert len(points(line_chart([Curve("", np.arange(1.0, 5.0), y)], x=Axis("x"), y=Axis("y", True)))) == 2
    assert "no values" in line_chart([Curve("", np.array([1.0]), np.array([np.nan]))], x=Axis("x"), y=Axis("y"))
    parsed(line_chart([Curve("", np.array([1.0]), np.array([5.0]))], x=Axis("x", True), y=Axis("y", True)))


def test_a_page_holds_results_and_whatever_else_it_is_given():
    page = to_html(RIG, "a < b", title=NASTY)
    assert page.startswith("<!doctype html>")
    assert "<pre>a &lt; b</pre>" in page
    assert "left_vertical" in page
    assert NASTY not in page


def test_a_figure_that_a_rig_without_valves_does_not_tell_is_a_dash():
    """Nothing was measured there: 0.00 % and 0 N would say that it was, and that all is well."""
    drive = Signals((Channel("nose", "N", minimum=-1.0, maximum=1.0),), 100.0, np.zeros((1, 10)))
    without = ActuatorUse(drive="nose", peak_command_ratio=0.5, saturated_share=0.0, largest_following_error=0.0)
    (row,) = actuator_rows([without], drive)
    assert (row.saturated, row.load_pressure, row.supply_pressure, row.following_error) == ("–", "–", "–", "–")
    assert str(Played("x", drive, (without,), 1.0)).splitlines()[-1].split() == ["nose", "50", "%", "–", "–"]
    told = {"largest_following_error": 0.25, "largest_load_pressure_share": 0.5, "lowest_supply_pressure": 2.8e7}
    (row,) = actuator_rows([dataclasses.replace(without, **told)], drive)
    figures = (row.saturated, row.load_pressure, row.supply_pressure, row.following_error)
    assert figures == ("0.00 %", "50 %", "280 bar", "0.25 N")
