"""A recording of format version 1 is opened, judged, reported, compared and exported as its own reader did."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from test_cli import invoke

import duralab

DATA = Path(__file__).resolve().parents[3] / "libs" / "recordings" / "tests" / "data"
OLD = DATA / "version1.mcap"
SAID = json.loads((DATA / "version1.json").read_text())
ORIGIN = " The limits to judge by were taken from the text of the campaign file in the recording."


def digest(samples):
    return hashlib.sha256(np.ascontiguousarray(samples, dtype="<f8").tobytes()).hexdigest()


@pytest.fixture(scope="module")
def recording():
    return duralab.open(OLD)


def test_its_figures_and_verdict_are_what_they_were(recording):
    table, verdict = recording.iterations, recording.verdict
    assert list(table.channels) == SAID["channels"]
    for name in ("relative_rms_error", "rms_response", "peak_ratio", "damage_ratio"):
        assert getattr(table, name).tolist() == SAID[name]
    assert verdict.judgement.value == SAID["judgement"]
    # One sentence has other words since.
    sentence = SAID["sentence"].replace(
        "It went on to the last playback planned", "The campaign used all planned iterations"
    )
    assert verdict.sentence == sentence + ORIGIN
    for name, limit in SAID["limits"].items():
        assert getattr(verdict.limits, name) == (tuple(limit) if isinstance(limit, list) else limit)
    assert (list(recording.runs), recording.model.id) == (SAID["runs"], SAID["model"])


def test_its_signals_are_what_they_were(recording):
    for said in SAID["steps"]:
        playback = recording.playback(said["number"])
        for name in ("drive", "response", "response_in_band"):
            assert digest(getattr(playback, name).samples) == said[name]
        assert playback.response_in_band.samples.dtype == np.float64
    assert digest(recording.target.samples) == SAID["target"]
    assert digest(recording.error("version1.i02")["a_force"].values) == SAID["error_i02"]
    assert digest(recording.responses("version1.i02", in_band=True)["a_force"].values) == SAID["in_band_i02"]
    assert digest(recording.responses("version1.i02")["b_force"].values[100:350]) == SAID["window"]
    assert digest(recording.signal("version1.confirm01")[1].samples) == SAID["confirmation"]


def test_it_is_verified_reported_compared_and_exported(tmp_path):
    assert invoke("verify", str(OLD))[0] == 0
    code, _, said = invoke("report", str(OLD), "--out", str(tmp_path / "report.html"))
    assert code in (0, 3), said
    assert ORIGIN.strip() in (tmp_path / "report.html").read_text()
    code, _, said = invoke("export", str(OLD), str(tmp_path / "best.csv"))
    assert code == 0, said
    code, _, said = invoke("compare", str(OLD), str(OLD), "--out", str(tmp_path / "compared.html"))
    assert code == 0, said
