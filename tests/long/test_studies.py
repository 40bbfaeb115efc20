"""The studies of docs/studies still run, and what they judge by is right."""

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest

STUDIES = Path(__file__).resolve().parents[2] / "studies"
NAMES = (
    "figure_3",
    "figure_4",
    "figure_5",
    "figure_7",
    "figure_8",
    "figure_9",
    "excitation_against_time",
    "algorithms_on_random_plants",
    "reachable_floor",
    "sensitivity",
    "braking_and_non_square",
    "input_side_errors",
    "stiff_rig",
    "detection_of_wear",
    "iterating_again",
)


@pytest.fixture
def study_module(monkeypatch):
    monkeypatch.syspath_prepend(str(STUDIES))
    return importlib.import_module


def random_frf(seed):
    return np.random.default_rng(seed).standard_normal((50, 3, 2, 2)) @ np.array([1.0, 1.0j])


@pytest.mark.parametrize("name", NAMES)
def test_every_study_writes_its_page_and_pictures(study_module, tmp_path, name):
    findings = study_module(name).study(True)
    study_module("study_page").write(name, findings, tmp_path)
    assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert "</svg>" in (tmp_path / f"{name}.svg").read_text()
    figures = re.findall(r"([\d.e+-]+|nan|inf) %", findings.table)
    assert len(figures) >= 6
    assert all(0.0 < float(figure) < 200.0 for figure in figures)
    assert findings.table in (tmp_path / f"{name}.md").read_text()


def test_an_svg_has_the_same_bytes_each_time(study_module, tmp_path):
    page = study_module("study_page")
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        figure, axes = page.plt.subplots()
        axes.semilogy([1.0, 2.0], [1.0, 10.0], label="a")
        axes.legend()
        page.write("figure_3", page.Findings(figure, "| a |"), tmp_path / folder)
    assert (tmp_path / "one" / "figure_3.svg").read_bytes() == (tmp_path / "two" / "figure_3.svg").read_bytes()


def test_a_quick_run_never_replaces_the_figures_of_the_docs(study_module, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["figure_3.py", "--quick"])
    with pytest.raises(SystemExit):
        study_module("study_page").run("figure_3", lambda quick: pytest.fail("it ran"))
    assert "mean nothing" in capsys.readouterr().err


def test_the_relative_error_knows_no_units(study_module):
    frf_error = study_module("frf_error")
    true, estimated = random_frf(1), random_frf(2)
    levels, rows = np.array([0.004, 600.0]), np.array([1.0, 1e3, 1e-5])
    plain = frf_error.relative_error(estimated, true, levels=(1.0, 1.0))
    scale = rows[:, None] / levels
    np.testing.assert_allclose(frf_error.relative_error(estimated * scale, true * scale, levels=levels), plain)
    np.testing.assert_allclose(frf_error.relative_error(1.1 * true, true, levels=levels), 0.1)


def test_bias_is_what_stays_and_scatter_what_changes(study_module):
    frf_error, true = study_module("frf_error"), random_frf(3)
    estimates = [(1.2 + step) * true for step in (-0.05, 0.05)]
    bias, scatter = frf_error.bias_and_scatter(estimates, true, levels=(1.0, 1.0))
    np.testing.assert_allclose(bias, 0.2)
    np.testing.assert_allclose(scatter, np.std([-0.05, 0.05], ddof=1))


def test_the_first_part_of_a_record_is_whole_sets_of_the_same_experiments(study_module):
    from duralab_settings import ExcitationKind

    cell = study_module("studied_rigs").aerospace(1024)
    columns, block = 4, cell.block_seconds
    record = cell.play(cell.settings(ExcitationKind.HADAMARD, seconds=60.0, seed=1))
    part = record.first(2 * columns * 2 * block + cell.fade_seconds + 0.9 * columns * block)
    assert part is not None
    assert part.layout.captures == record.layout.captures[: 2 * columns]
    np.testing.assert_array_equal(part.response, record.response[:, : part.layout.samples])
    assert record.first(columns * 2 * block) is None  # its last fade does not fit


def test_a_stop_pulls_a_wheel_backwards_and_turns_its_spindle_by_the_rolling_radius(study_module):
    loads = study_module("braking_loads")
    road, stopping = (loads.spindle_target(4.0, potholes=1, stops=stops) for stops in ((), ((1.5, 1.0),)))
    pulled = stopping[:6] - road
    np.testing.assert_array_equal(pulled[[0, 1, 3, 4]], 0.0)
    scale = np.abs(pulled).max()
    np.testing.assert_allclose(stopping[6:] / scale, -0.32 * pulled[[2, 5]] / scale, atol=1e-12)
    assert 1000.0 < scale < 3000.0


def test_conditions_change_models_and_neither_rigs_nor_targets(study_module):
    campaigns = study_module("random_plant_campaigns")
    usual, other = (
        campaigns.make_bench(1, samples=1280, seed=1, conditions=conditions)
        for conditions in (campaigns.Conditions(), campaigns.Conditions(noise=0.1, level=0.4, block_samples=256))
    )
    np.testing.assert_array_equal(usual.targets, other.targets)
    np.testing.assert_array_equal(usual.plants.valve_speed, other.plants.valve_speed)
    assert usual.models[0].block_samples == 512
    assert other.models[0].block_samples == 256


@pytest.mark.parametrize("on_drives", [True, False])
def test_a_mistake_of_one_channel_needs_a_diagonal_correction_on_its_own_side_only(study_module, on_drives):
    study, campaigns = study_module("input_side_errors"), study_module("low_level_campaigns")
    rig = campaigns.identified(1.0, 1)
    model = study.mistaken(rig, study.MISTAKES[0], on_drives=on_drives)
    target = np.random.default_rng(1).standard_normal((6, 100))
    forward, backward, _ = study.told_of_theory(rig, model, target)
    assert float(backward if on_drives else forward) == 0.0
    assert float(forward if on_drives else backward) > 0.5


@pytest.mark.parametrize("text", ["no markers", "<!-- numbers: studies/a.py -->", "<!-- end of numbers -->" * 2])
def test_a_page_without_both_markers_is_refused(study_module, text):
    with pytest.raises(ValueError, match="put both in once"):
        study_module("marked_numbers").between_markers(text, "1", script=Path("a.py"))
