"""Results in Parquet, and the report that compares them."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace

import pyarrow
import pytest
from pyarrow import parquet

from duralab.errors import InputError
from duralab.sweeps import PLAYBACKS, RESULTS, load_sweep, read_results, write_report
from duralab.sweeps.results import Costs, Outcome, State, read_outcome, write_outcome, write_results


def outcome(id, error):
    return Outcome(
        id=id,
        state=State.FINISHED,
        sentence="The target was reached.",
        judgement="reached",
        best_playback=2,
        overall_error=error,
        worst_error=2 * error,
        channels=("left", "right"),
        watched=(False, True),
        numbers=(1, 2),
        errors=((0.5, float("nan")), (2 * error, 0.1)),
        rms_responses=((1.0, 1.0), (1.0, 0.9)),
        overall=(0.5, error),
        rig_hash="ab",
        worker="here:1",
        costs=Costs(0.5, 1.5, 1.2),
        bytes=1000,
    )


def rows():
    made = [({"update.iteration_gain": gain, "kind": kind}, outcome(f"{gain}{kind}", abs(gain - 0.7) + 0.01))
            for gain in (0.5, 0.7, 1) for kind in ("<h1>", "hv")]  # fmt: skip
    return [
        *made,
        ({"update.iteration_gain": 2.0, "kind": "hv"}, Outcome("bad", State.FAILED, "The gain of <2> is too large.")),
    ]


@pytest.fixture
def results(tmp_path):
    return write_results(tmp_path, load_sweep("fifty_gains_and_seeds"), rows(), total=8)


def test_an_outcome_is_read_as_it_was_written(tmp_path):
    written = outcome("a", 0.1)
    write_outcome(written, tmp_path)
    read = read_outcome(tmp_path)
    assert (read.id, read.state, read.costs) == (written.id, written.state, written.costs)
    assert tuple(read.overall) == written.overall
    assert read_outcome(tmp_path / "nowhere") is None
    (tmp_path / "outcome.parquet").write_bytes(b"not it")
    with pytest.raises(InputError, match="remove it"):
        read_outcome(tmp_path)


def test_results_are_plain_tables(results, tmp_path):
    table = parquet.read_table(tmp_path / RESULTS)
    assert table.schema.field("update.iteration_gain").type == pyarrow.float64()
    assert table.num_rows == 7
    playbacks = parquet.read_table(tmp_path / PLAYBACKS).to_pylist()
    assert len(playbacks) == 6 * 2 * 2
    assert {row["channel"] for row in playbacks} == {"left", "right"}
    again = read_results(tmp_path)
    assert again.keys == ("update.iteration_gain", "kind")
    assert (len(again.finished), len(again.failed), again.total) == (6, 1, 8)
    assert again.best["update.iteration_gain"] == 0.7
    assert again.rows == results.rows


def test_a_folder_without_results_is_told(tmp_path):
    with pytest.raises(InputError, match="holds no"):
        read_results(tmp_path)
    (tmp_path / RESULTS).write_bytes(b"x")
    with pytest.raises(InputError, match="is not the result"):
        read_results(tmp_path)


def test_the_report_compares_and_opens_offline(results, tmp_path):
    page = write_report(results, tmp_path / "report.html").read_text(encoding="utf-8")
    before_scripts = page.split("<script")[0]
    assert "http://" not in before_scripts
    assert "https://" not in before_scripts
    words = html.unescape(before_scripts)
    best = results.best
    assert f"{best['overall_error']:.4f}" in words
    assert f"points/{best['id']}/campaign.yaml" in words.replace("'", "")
    assert "The gain of <2> is too large." in words
    # What a user wrote is text, never markup.
    assert "<h1>" not in before_scripts.split("<h1>fifty")[1]
    drawn = json.loads(re.search(r'id="figures">(.*?)</script>', page, re.S).group(1).replace("<\\/", "</"))
    lines = drawn["all"]
    assert lines["layout"]["xaxis"]["ticktext"] == ["update.iteration_gain", "kind", "overall error", "worst error"]
    # Six lines of four places with a gap after each; the best is drawn last and lowest where errors are.
    heights = [height for trace in lines["data"] for height in trace["y"]]
    assert len(heights) == 6 * 5
    assert all(height is None or 0.0 <= height <= 1.0 for height in heights)
    assert lines["data"][-1]["y"][2:4] == [0.0, 0.0]
    assert [trace["name"] for trace in drawn["axis-0"]["data"]] == ["0.5", "0.7", "1"]


def test_a_best_point_that_did_not_reach_its_target_is_not_shown_as_good(tmp_path):
    settings, good = rows()[0]
    missed = replace(
        good, judgement="not reached", sentence="The target was not reached: damage at k = 5 of left is 0.5."
    )
    sweep = load_sweep("fifty_gains_and_seeds")
    for made, tone, reached in ((missed, "bad", 0), (good, "good", 1)):
        found = write_results(tmp_path, sweep, [(settings, made)], total=1)
        page = write_report(found, tmp_path / "report.html").read_text(encoding="utf-8")
        assert f'<div class="verdict {tone}">' in page
        assert made.sentence in page
        assert f"<b>{reached}</b><span>reached their target</span>" in page


def test_a_sweep_that_failed_as_a_whole_has_a_report_too(tmp_path):
    failed = [({"seed": 1}, Outcome("a", State.FAILED, "The rig is out."))]
    results = write_results(tmp_path, load_sweep("fifty_gains_and_seeds"), failed, total=1)
    assert "The rig is out." in write_report(results, tmp_path / "r.html").read_text()


def test_nothing_to_report_is_told(tmp_path):
    results = write_results(tmp_path, load_sweep("fifty_gains_and_seeds"), [], total=1)
    with pytest.raises(InputError, match="nothing to report"):
        write_report(results, tmp_path / "r.html")
