"""`duralab run --profile`: one trace of all five processes, whose shares are those of that very campaign."""

import json
import subprocess
import sys

import pytest

import duralab
from duralab.profile import Profile
from duralab_bus import SpanKind


def test_a_campaign_leaves_a_trace_of_all_its_processes(campaign, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "duralab", "run", str(campaign()), "--out", str(out), "--profile"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 3), done.stderr
    trace = json.loads((out / "profile.json").read_text())
    events = trace["traceEvents"]
    named = {event["pid"]: event["args"]["name"] for event in events if event["ph"] == "M"}
    assert sorted(named.values()) == ["duralab", "identifier", "iterator", "recorder", "rig_sim"]
    spans = [event for event in events if event["ph"] == "X"]
    assert {event["pid"] for event in spans} == named.keys()
    assert {event["cat"] for event in spans} == {kind.value for kind in SpanKind}
    # Each playback is one wait of the iterator for the rig, and the rig plays within it.
    recording = duralab.open(out / "recording.mcap")
    asked = [event for event in spans if event["name"].startswith("ask ") and event["name"].endswith("/play")]
    (iterator,) = (pid for pid, name in named.items() if name == "iterator")
    waits = [event for event in asked if event["pid"] == iterator]
    assert len(waits) == len(recording.iterations)
    blocks = [event for event in spans if event["name"] == "play a block"]
    for wait in waits:
        inside = [one for one in blocks if wait["ts"] <= one["ts"] <= wait["ts"] + wait["dur"]]
        assert sum(one["dur"] for one in inside) <= wait["dur"]
        assert inside
    profile = Profile(events)
    began, ended = profile.period
    shares = profile.shares(began, ended)
    assert sum(shares.values()) == pytest.approx(ended - began)
    assert min(shares.values()) >= 0.0
    assert shares[SpanKind.PLAYBACK] > 0.0
    assert "playback by the rig" in done.stdout
