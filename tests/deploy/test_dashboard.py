"""Dashboards and alerts: they name figures that a lab at work tells, and the dashboards show all of them."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

import pytest
import yaml

import duralab
from duralab.lab.status import Figure
from duralab_bus import FigureKind

from .compose_file import ROOT

DASHBOARDS = sorted((ROOT / "deploy" / "grafana").glob("*.json"))
ALERTS = ROOT / "deploy" / "prometheus" / "alerts.yml"
NAME = re.compile(r"\b(?:duralab|process)_[a-z0-9_]+")
# Told by the client library of Prometheus itself.
PROCESS = {"process_cpu_seconds_total", "process_resident_memory_bytes"}


def expressions() -> list[str]:
    panels = [panel for dashboard in DASHBOARDS for panel in json.loads(dashboard.read_text())["panels"]]
    return [target["expr"] for panel in panels for target in panel.get("targets", [])]


def alert_expressions() -> list[str]:
    (group,) = yaml.safe_load(ALERTS.read_text())["groups"]
    return [rule["expr"] for rule in group["rules"]]


@dataclass(frozen=True)
class Watched:
    """What a lab told while it ran a campaign and an endurance test: a figure of each name, and lines of its logs."""

    figures: dict[str, Figure]
    logs: dict[str, list[dict[str, Any]]]
    campaign: str


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory, short_document: dict[str, Any]) -> Watched:
    folder = tmp_path_factory.mktemp("lab")
    file = folder / "campaign.yaml"
    # Held at each playback: the error of a campaign is a figure only while it runs.
    file.write_text(yaml.safe_dump(short_document | {"hold": "each"}))
    found: dict[str, Figure] = {}

    def look(lab: duralab.Lab) -> None:
        for service in lab.health():
            assert service.trouble == ""
            found.update({figure.name: figure for figure in service.figures})

    with (
        duralab.start(folder / "out", rigs=("front_axle_compliant", "predecessor"), endurance=True) as lab,
        duralab.connect(lab.endpoints[0]) as other,
    ):

        def look_and_play(progress: duralab.RunProgress) -> None:
            look(lab)
            if progress.hold is not None and progress.hold.number not in decided:
                other.decide(progress.campaign, "play", proposal=progress.hold.number, name="Ada", reason="watched")
                decided.add(progress.hold.number)

        decided: set[int] = set()
        result = lab.run(file, on_progress=look_and_play)
        assert decided == {1, 2, 3}
        look(lab)
        campaign = result.recording.specification.id
        schedule = folder / "weeks.yaml"
        drive = {"drive": str(result.recording_path), "repeats": 30, "missed_target_accepted": True}
        schedule.write_text(
            yaml.safe_dump({"name": "weeks", "rig": result.recording.specification.rig, "events": {"road": drive}})
        )
        lab.endure(schedule).wait(on_progress=lambda _progress: look(lab))
    logs = {
        path.stem: [json.loads(line) for line in path.read_text().splitlines()]
        for path in (folder / "out" / "logs").glob("*.log")
    }
    return Watched(found, logs, campaign)


@pytest.fixture(scope="module")
def seen(watched: Watched) -> dict[str, Figure]:
    return watched.figures


def test_lab_tells_every_figure_that_dashboards_and_alerts_name(seen: dict[str, Figure]) -> None:
    named = {name for text in [*expressions(), *alert_expressions()] for name in NAME.findall(text)}
    assert len(named) > 25
    assert sorted(named - PROCESS - set(seen)) == []


def test_dashboards_show_every_figure_of_a_lab(seen: dict[str, Figure]) -> None:
    shown = {name for text in expressions() for name in NAME.findall(text)}
    assert sorted(set(seen) - shown) == []


def test_counters_are_read_as_rates_and_labels_are_there(seen: dict[str, Figure]) -> None:
    for text in expressions():
        for name in NAME.findall(text):
            counts = name in seen and seen[name].kind is FigureKind.COUNTER
            whole = text.startswith("sum(duralab_stream_lost")
            assert not counts or whole or re.search(rf"(?:rate|increase)\({name}\[", text), text
        for by in re.findall(r"by \(([a-z, ]+)\)", text):
            (name,) = NAME.findall(text)
            assert set(by.split(", ")) <= {*seen[name].labels, "job"}, text


def test_figures_are_those_of_the_campaign(seen: dict[str, Figure]) -> None:
    assert seen["duralab_stream_lost_messages_total"].value == 0.0
    assert seen["duralab_recorder_missing_blocks_total"].value == 0.0
    assert seen["duralab_rig_real_time_factor"].value > 0.0
    assert seen["duralab_campaigns_ended_total"].labels == {"phase": "FINISHED"}


def test_logs_name_the_run_the_campaign_and_the_recording(watched: Watched) -> None:
    assert set(watched.logs) == {"rig_sim", "identifier", "iterator", "sequencer", "recorder"}
    for service, lines in watched.logs.items():
        assert all({"event", "level", "timestamp", "service"} <= set(line) for line in lines)
        assert {line["service"] for line in lines} == {service}
    played = [line for line in watched.logs["rig_sim"] if line["event"] == "played"]
    of_rig = [line["run"] for line in played if line["rig"] == "front_axle_compliant"]
    of_campaign = [run for run in of_rig if not run.startswith("weeks.")]
    # The experiment and three playbacks.
    assert len(of_campaign) == len(set(of_campaign)) == 4
    assert all(run.startswith(f"{watched.campaign}.") for run in of_campaign)
    assert len(of_rig) == 4 + 30
    identified = [line for line in watched.logs["identifier"] if line["event"] == "identified"]
    assert [line["run"] for line in identified] == [run for run in of_campaign if run == identified[0]["run"]]
    ended = [line for line in watched.logs["iterator"] if line["event"] == "campaign ended"]
    assert [(line["campaign"], line["rig"]) for line in ended] == [(watched.campaign, "front_axle_compliant")]
    closed = [line for line in watched.logs["recorder"] if line["event"] == "recording closed"]
    assert [line["recording"] for line in closed] == [watched.campaign, "weeks"]
