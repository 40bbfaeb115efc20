"""A real campaign that a script decides on at each hold point: from the command line, the SDK and `async` code."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import duralab
from duralab.cli.application import app
from duralab_settings import DecisionKind


def command_line(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == 0, result.stdout + result.stderr
    return result.stdout


SAID = ("--name", "Ada Lovelace", "--reason", "as <b>foreseen</b>")


@pytest.fixture(scope="module")
def driven(
    lab: duralab.Lab, short_document: dict[str, Any], tmp_path_factory: pytest.TempPathFactory
) -> tuple[duralab.Recording, str]:
    """The recording of a campaign, and what `duralab run` said without a terminal; gains 3, back to 2 at 5."""
    import yaml

    folder = tmp_path_factory.mktemp("held")
    document = short_document | {"name": "held", "hold": "each"}
    document["stop"] = document["stop"] | {"iterations": 5}
    document["update"] = document["update"] | {"kind": "basic_twr", "iteration_gain": 0.5}
    (folder / "held.yaml").write_text(yaml.safe_dump(document))
    endpoint = lab.endpoints[0]
    command = [sys.executable, "-m", "duralab", "run", str(folder / "held.yaml"), "--connect", endpoint]
    with subprocess.Popen(
        [*command, "--out", str(folder / "out")], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as running:
        assert running.stdout is not None
        lines = []
        for line in running.stdout:
            lines.append(line)
            if line.startswith("Decide: "):
                decide(lab, int(line.partition("--proposal ")[2].split()[0]), endpoint)
        assert running.wait(120.0) in (0, 3), "".join(lines)
    return duralab.open(folder / "out" / "recording.mcap"), "".join(lines)


def decide(lab: duralab.Lab, proposal: int, endpoint: str) -> None:
    """Do what the script says: gains changed at playback 3, back to 2 at 5."""
    named = ("--proposal", str(proposal), "--connect", endpoint)
    match proposal:
        case 1:
            status = json.loads(command_line("status", "--connect", endpoint, "--json"))
            (under_way,) = status["labs"][0]["campaigns"]
            assert under_way["proposal"] == 1
            assert under_way["activity"].startswith("waiting for a decision on proposal 1, before iteration 1 of 5")
            shown = command_line("decide", "held", "--connect", endpoint)
            assert "Proposal 1: the drive of playback 1, the first" in shown
            found = lab.proposal("held")
            assert found is not None
            assert found.drive is not None
            np.testing.assert_array_equal(np.abs(found.drive.samples).max(axis=1), [use.peak for use in found.drives])
            with pytest.raises(duralab.InputError, match="reason"):
                lab.decide("held", "play", proposal=1, name="Ada", reason=" ")
            with pytest.raises(duralab.InputError, match="is change with no settings"):
                lab.decide("held", "change", proposal=1, name="Ada", reason="x")
            with pytest.raises(duralab.InputError, match="did you mean 'iteration_gain'"):
                lab.decide("held", "change", proposal=1, name="Ada", reason="x", settings={"update": {"gains": 0.2}})
            with pytest.raises(duralab.InputError, match="has stop; at a hold point"):
                lab.decide("held", "change", proposal=1, name="Ada", reason="x", settings={"stop": {"iterations": 9}})
            command_line("decide", "held", "play", *named, *SAID)
            with pytest.raises(duralab.NotReadyError):
                lab.decide("held", "play", proposal=1, name="Ada", reason="again")
        case 3:
            command_line("decide", "held", "change", *named, "--set", "update.iteration_gain=0.9", *SAID)
        case 6:
            lab.decide("held", DecisionKind.BACK, proposal=6, name="Grace", reason="it got worse", from_iteration=2)
        case 7:

            async def play() -> None:
                async with duralab.async_connect(endpoint) as other:
                    await other.decide("held", "play", proposal=7, name="Grace", reason="better")

            asyncio.run(play())
        case _:
            command_line("decide", "held", "play", *named, *SAID)


def test_the_recording_says_who_decided_what(driven: tuple[duralab.Recording, str]) -> None:
    recording, _ = driven
    decisions = recording.decisions
    assert [(found.playback, found.proposal, found.kind.value) for found in decisions] == [
        *((1, 1, "play"), (2, 2, "play"), (3, 3, "change"), (3, 4, "play"), (4, 5, "play")),
        *((5, 6, "back"), (5, 7, "play")),
    ]
    assert [found.name for found in decisions] == 5 * ["Ada Lovelace"] + 2 * ["Grace"]
    assert decisions[5].from_iteration == 2
    gains = np.frombuffer(recording.specification_in_use.update.iteration_gain.data)
    assert gains.tolist() == 6 * [0.9]
    assert np.frombuffer(recording.specification.update.iteration_gain.data).tolist() == 6 * [0.5]
    assert "iteration_gain: 0.9" in recording.specification_in_use.scenario


def test_what_was_proposed_last_for_a_playback_is_what_was_played(driven: tuple[duralab.Recording, str]) -> None:
    recording, _ = driven
    proposals = {proposal.playback: proposal for proposal in recording.proposals}
    for number in range(1, 6):
        drive = proposals[number].drive
        assert drive is not None
        np.testing.assert_array_equal(drive.samples, recording.playback(number).drive.samples)
    # Made from the same playback with the same settings.
    np.testing.assert_array_equal(recording.playback(5).drive.samples, recording.playback(3).drive.samples)
    assert (proposals[3].follows, proposals[5].follows) == (2, 2)


def test_a_run_without_a_terminal_says_how_to_decide(driven: tuple[duralab.Recording, str], lab: duralab.Lab) -> None:
    _, said = driven
    command = "decide held play --proposal 1 --name NAME --reason TEXT --connect"
    assert f"{command} {lab.endpoints[0]}" in said
    assert said.count("Decide: ") == 7


def test_the_report_says_who_decided_what(driven: tuple[duralab.Recording, str], tmp_path: Path) -> None:
    recording, _ = driven
    page = duralab.write_report(recording, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Decisions at hold points" in page
    assert page.count("Ada Lovelace") == 5
    assert "as &lt;b&gt;foreseen&lt;/b&gt;" in page
    assert "back to playback 2" in page
    assert "0.9" in page[page.index("change: Update") :][:400]


def test_a_resume_with_other_settings_keeps_what_was_decided(
    driven: tuple[duralab.Recording, str], lab: duralab.Lab, tmp_path: Path
) -> None:
    (tmp_path / "longer.yaml").write_text("stop: {iterations: 6}\n")
    with duralab.connect(lab.endpoints[0], out=tmp_path / "out") as other:

        def follow(progress: duralab.RunProgress) -> None:
            if progress.hold is not None and not decided:
                decided.append(progress.hold.playback)
                other.decide(progress.campaign, "play", proposal=progress.hold.number, name="Ada", reason="go on")

        decided: list[int] = []
        result = other.resume("held", settings=tmp_path / "longer.yaml", on_progress=follow)
    wanted = duralab.open(result.recording_path).specification
    assert decided == [6]
    assert (wanted.parent, wanted.stop.iterations) == ("held", 6)
    assert np.frombuffer(wanted.update.iteration_gain.data).tolist() == 6 * [0.9]
    assert "iteration_gain: 0.9" in wanted.scenario


def test_a_campaign_whose_band_was_changed_is_read_in_its_bands(
    lab: duralab.Lab, campaign: Callable[..., Path], tmp_path: Path
) -> None:
    with duralab.connect(lab.endpoints[0], out=tmp_path / "out") as other:

        def follow(progress: duralab.RunProgress) -> None:
            hold = progress.hold
            if hold is None or hold.number in decided:
                return
            decided.add(hold.number)
            settings = {"control_band": {"highest_frequency": 20.0}} if hold.number == 2 else None
            kind = "change" if settings else "play"
            other.decide(
                progress.campaign, kind, proposal=hold.number, name="Ada", reason="narrower", settings=settings
            )

        decided: set[int] = set()
        result = other.run(campaign(name="banded", hold="each", stop__iterations=2), on_progress=follow)
    recording = duralab.open(result.recording_path)
    assert decided == {1, 2, 3}
    first, second = (recording.playback(number).response_in_band.samples for number in (1, 2))
    rate = recording.specification.target.sample_rate
    above = np.fft.rfftfreq(first.shape[1], 1.0 / rate) > 25.0
    shares = [np.sum(np.abs(np.fft.rfft(samples)[:, above]) ** 2) for samples in (first, second)]
    assert shares[1] < 1e-3 * shares[0]
    error = recording.error(f"{recording.specification.id}.i02")
    assert error.attrs["highest_frequency"] == 20.0
    with pytest.raises(duralab.InputError, match=r"i01 .* judged in another control band"):
        recording.error()
    judged = np.array([error[name].values for name in recording.iterations.channels])
    relative = np.sqrt(np.mean(judged**2, axis=1) / np.mean(recording.target.samples**2, axis=1))
    np.testing.assert_allclose(relative, recording.iterations.relative_rms_error[1], rtol=1e-5)
    assert duralab.write_report(recording, tmp_path / "report.html").exists()
