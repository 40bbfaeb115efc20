"""`duralab compare`: recordings beside each other, on the screen, as JSON and in one file."""

import json

from test_cli import invoke


def test_two_recordings_are_laid_over_each_other(recording_path, tmp_path):
    out = tmp_path / "both.html"
    code, stdout, stderr = invoke("compare", recording_path, recording_path, "--out", out)
    assert code == 0, stderr
    assert "relative RMS error after the best playback" in stdout
    assert f"Comparison: {out}" in stdout
    assert out.read_text(encoding="utf-8").lstrip().lower().startswith("<!doctype html>")


def test_as_json_it_is_one_document(recording_path, tmp_path):
    code, stdout, _ = invoke("compare", recording_path, recording_path, "--out", tmp_path / "c.html", "--json")
    assert code == 0
    told = json.loads(stdout)
    assert told["comparison"] == str(tmp_path / "c.html")
    assert len(told["recordings"]) == 2
    assert told["differences"] == []


def test_nothing_is_overwritten_unasked_and_one_recording_is_too_few(recording_path, tmp_path):
    out = tmp_path / "c.html"
    out.write_text("mine")
    code, _, stderr = invoke("compare", recording_path, recording_path, "--out", out)
    assert code == 2
    assert "give --replace" in stderr
    assert out.read_text() == "mine"
    code, _, stderr = invoke("compare", recording_path, "--out", tmp_path / "d.html")
    assert code == 2
    assert "give two or more" in stderr
    assert not (tmp_path / "d.html").exists()
