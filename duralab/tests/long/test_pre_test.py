"""Pre-tests from scripts and the command line: healthy and faulty rigs, whole recordings, a campaign's demand."""

import json
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import yaml
from test_command_line import invoke

import duralab
from duralab.campaign import parse_campaign
from duralab.errors import InputError, NotReadyError
from duralab.formats import read_signals, write_signals
from duralab.lab import Result
from duralab.testing import LinearRig, lab

NAMES = ("force_1", "force_2")
AXLE = [f"{side}_{axis}" for side in ("left", "right") for axis in ("vertical", "lateral", "longitudinal")]


class FaultyRig(LinearRig):
    """A linear rig whose wiring changes while it is served."""

    def __init__(self):
        super().__init__(noise_rms=1.0)
        self.fault = None

    def play(self, commands, run):
        response = super().play(commands, run)
        return response if self.fault is None else self.fault(response)


FAULTS = {
    "polarity": (lambda response: response * [[1.0], [-1.0]], ("force_2",)),
    "swapped": (lambda response: response[::-1], NAMES),
    "dead": (lambda response: response * [[0.0], [1.0]], ("force_1",)),
    "noise": (
        lambda response: response + [[0.0], [2e4]] * np.random.default_rng(1).standard_normal(response.shape),
        ("force_2",),
    ),
    "offset": (lambda response: np.add(response, [[3e4], [0.0]]), ("force_1",)),
    "saturation": (lambda response: np.clip(response, [[-1e9], [-40.0]], [[1e9], [40.0]]), ("force_2",)),
}


@pytest.fixture(scope="module")
def tried(tmp_path_factory):
    rig = FaultyRig()
    with lab(rig, out=tmp_path_factory.mktemp("lab")) as started:
        yield rig, started


@contextmanager
def broken(rig, fault):
    rig.fault = fault
    try:
        yield
    finally:
        rig.fault = None


def test_a_healthy_rig_passes_and_each_seeded_fault_is_found_beside_it(tried):
    rig, started = tried
    shown = []
    first = started.pre_test("linear", id="first", seed=1, on_progress=shown.append)
    assert first.passed
    assert first.findings == ()
    assert shown[0].stage == "pre-test"
    # 5 % of 0.1 m.
    np.testing.assert_allclose(first.amplitude, [0.005, 0.005])
    np.testing.assert_allclose(first.noise, 1.0, rtol=0.1)
    assert "is not checked" in first.expectations[0]
    assert "The pre-test of linear passed; its recording is first." in str(first)
    for number, (check, (fault, channels)) in enumerate(FAULTS.items()):
        with broken(rig, fault):
            found = started.pre_test("linear", id=f"fault-{number}", seed=10 + number)
        assert found.expectations == ("Polarity, order, lag and gain are compared with the pre-test 'first'.",)
        assert not found.passed
        wrong = [finding for finding in found.findings if finding.failed]
        assert check in {finding.check for finding in wrong}
        assert set(channels) <= {name for finding in wrong for name in finding.channels}
        assert "did not pass, with 1 failure" in found.verdict or len(wrong) > 1
    assert started.pre_test("linear", id="last", seed=30).passed


def test_recordings_of_pre_tests_are_listed_and_whole(tried):
    rig, started = tried
    folder = started.out
    found = started.pre_test("linear", id="listed", seed=2)
    with broken(rig, FAULTS["polarity"][0]):
        started.pre_test("linear", id="listed-failed", seed=3)
    results = {entry.id: (entry.result, entry.rig) for entry in started.catalogue.search(rig="linear")}
    assert results["listed"] == (Result.PRE_TEST_PASSED, "linear")
    assert results["listed-failed"] == (Result.PRE_TEST_FAILED, "linear")
    assert started.catalogue.verify("listed") == []
    recording = duralab.open_recording(folder / "recordings" / "listed.mcap")
    assert str(recording.pre_test) == str(found)
    with pytest.raises(InputError, match=r"is that of a pre-test and holds no campaign; `open_recording"):
        _ = recording.specification
    drive, response = started.catalogue.signals("listed", "listed.pulses", first_second=0.0, seconds=60.0)
    np.testing.assert_allclose(response.samples, rig.respond(drive.samples, seed=2), atol=1e-6)
    assert np.abs(drive.samples).max(axis=1) == pytest.approx([0.005, 0.005])


def test_what_cannot_be_is_refused(tried):
    _, started = tried
    for level in (0.0, -1.0, 0.2, "half", True):
        with pytest.raises(InputError, match="level is"):
            started.pre_test("linear", level=level)
    with pytest.raises(InputError, match="There is no rig 'liner'"):
        started.pre_test("liner")
    started.pre_test("linear", id="taken", seed=4)
    with pytest.raises(InputError, match="exists already"):
        started.pre_test("linear", id="taken")


def test_the_command_prints_tables_and_verdict_and_ends_with_1_where_it_did_not_pass(tried):
    rig, started = tried
    started.pre_test("linear", id="before-the-command", seed=5)
    to_it = ("pre-test", "linear", "--connect", started.endpoints[0])
    code, stdout, _ = invoke(*to_it, "--seed", 6)
    assert code == 0
    assert "Peak of each response by drive, % of its largest:" in stdout
    assert "The pre-test of linear passed; its recording is linear-pre-test-" in stdout
    with broken(rig, FAULTS["polarity"][0]):
        code, stdout, _ = invoke(*to_it, "--seed", 7, "--json")
    document = json.loads(stdout[stdout.index("{\n") :])
    assert code == 1
    assert (document["passed"], document["rig"]) == (False, "linear")
    assert document["findings"][0]["check"] == "polarity"
    assert document["findings"][0]["channels"] == ["force_2"]
    assert [response["name"] for response in document["responses"]] == list(NAMES)
    assert invoke(*to_it, "--level", 0.5)[0] == 2


@pytest.fixture(scope="module")
def target(tried, tmp_path_factory):
    """Write the response to a random drive of 1 mm RMS as a measured file."""
    rig, _ = tried
    drive = 0.001 * np.random.default_rng(3).standard_normal((2, 20_000))
    channels = tuple(duralab.Channel(name, "N") for name in NAMES)
    path = tmp_path_factory.mktemp("target") / "road.csv"
    write_signals(duralab.Signals(channels, 1000.0, rig.respond(drive, seed=9)), path)
    return path


def test_the_levels_of_an_identification_follow_from_its_pulses_and_the_target(tried, target, tmp_path):
    rig, started = tried
    started.pre_test("linear", id="for-levels", level=0.01, seed=6)
    pulses = started.out / "recordings" / "for-levels.mcap"
    to_it = ("--target", target, "--connect", started.endpoints[0])
    # The rig is that of the pre-test.
    code, stdout, stderr = invoke("init", tmp_path / "mine.yaml", *to_it, "--pre-test", pulses)
    assert code == 0, stderr
    assert "not chosen for this target" not in stdout
    campaign = duralab.load_campaign(tmp_path / "mine.yaml")
    band = campaign.control_band.lowest_frequency, campaign.control_band.highest_frequency
    wanted = rms_in(band, read_signals(target).samples)
    for number, level in enumerate(campaign.excitation.rms.values()):
        slow = np.zeros((2, 20_000))
        slow[number] = np.sin(2.0 * np.pi * 2.0 * np.arange(20_000) / 1000.0)
        share = rms_in(band, rig.respond(level * np.sqrt(2.0) * slow, seed=7)) / wanted
        assert 0.4 < share.max() < 0.6
    assert campaign.rig == "linear"
    shares = invoke("init", tmp_path / "shares.yaml", *to_it, "--rig", "linear")
    assert shares[0] == 0
    assert "not chosen for this target; --pre-test chooses them." in shares[1]
    assert set(duralab.load_campaign(tmp_path / "shares.yaml").excitation.rms.values()) == {0.001}


def rms_in(band, record):
    lines = np.fft.rfft(record, axis=1)
    frequency = np.fft.rfftfreq(record.shape[1], 0.001)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    return np.sqrt(2.0 * np.sum(np.abs(lines[:, inside]) ** 2, axis=1)) / record.shape[1]


def test_no_levels_follow_from_a_failed_pre_test_another_rig_or_a_target_with_other_names(tried, target, tmp_path):
    rig, started = tried
    recordings = started.out / "recordings"
    init = ("init", tmp_path / "mine.yaml", "--target", target)
    with broken(rig, FAULTS["noise"][0]):
        started.pre_test("linear", id="levels-failed", seed=8)
    linear = ("--rig", "linear", "--connect", started.endpoints[0])
    code, _, stderr = invoke(*init, *linear, "--pre-test", recordings / "levels-failed.mcap")
    assert (code, "levels-failed did not pass; see to its findings" in stderr) == (2, True)
    started.pre_test("linear", id="levels-passed", seed=10)
    (tmp_path / "axle.yaml").write_text(yaml.safe_dump({"channels": dict.fromkeys(AXLE, "force_1")}))
    axle = ("--rig", "front_axle", "--settings", tmp_path / "axle.yaml")
    code, _, stderr = invoke(*init, *axle, "--pre-test", recordings / "levels-passed.mcap")
    assert (code, "is of another rig than 'front_axle'" in stderr) == (2, True)
    measured = read_signals(target)
    others = tuple(replace(channel, name=f"F_{channel.name}") for channel in measured.channels)
    write_signals(replace(measured, channels=others), tmp_path / "renamed.csv")
    to_it = (*linear, "--pre-test", recordings / "levels-passed.mcap")
    renamed = ("init", tmp_path / "mine.yaml", "--target", tmp_path / "renamed.csv", *to_it)
    code, _, stderr = invoke(*renamed)
    assert (code, "has no channel force_1, force_2, and levels by a pre-test need" in stderr) == (2, True)
    assert not (tmp_path / "mine.yaml").exists()
    (tmp_path / "map.yaml").write_text("channels: {force_1: F_force_1, force_2: F_force_2}\n")
    code, _, stderr = invoke(*renamed, "--settings", tmp_path / "map.yaml")
    assert code == 0, stderr
    assert invoke("init", tmp_path / "same.yaml", "--target", target, *to_it)[0] == 0
    levels = [duralab.load_campaign(tmp_path / f"{name}.yaml").excitation.rms for name in ("mine", "same")]
    assert levels[0] == levels[1]


CAMPAIGN = """
name: demanding
rig: linear
seed: 1
pre_test: 24
target: {file: target.csv}
excitation: {kind: pure_random, rms: 0.001, duration: 8, lowest_frequency: 1, highest_frequency: 100,
  corner_frequency: 20, decibels_per_octave: 3, fade: 0.5}
estimator: {kind: h1, block_samples: 1024}
control_band: {lowest_frequency: 3, highest_frequency: 80}
update: {kind: basic_twr, iteration_gain: 0.8}
stop: {iterations: 1}
"""


def test_a_campaign_that_demands_a_pre_test_is_refused_without_one(tmp_path):
    rig = FaultyRig()
    rig.name = "linear"
    time = np.arange(4000) / 1000.0
    wave = 50.0 * np.sin(2.0 * np.pi * 10.0 * time) * np.sin(np.pi * time / 4.0) ** 2
    rows = "\n".join(f"{t:.3f},{value:.6g},{-value:.6g}" for t, value in zip(time, wave, strict=True))
    (tmp_path / "target.csv").write_text(f"time [s],force_1 [N],force_2 [N]\n{rows}\n")
    (tmp_path / "demanding.yaml").write_text(CAMPAIGN)
    assert parse_campaign(CAMPAIGN, name="x").pre_test == 24.0
    with pytest.raises(InputError, match="pre_test is 0"):
        parse_campaign(CAMPAIGN.replace("pre_test: 24", "pre_test: 0"), name="x")
    with lab(rig, out=tmp_path / "lab") as started:
        with pytest.raises(NotReadyError, match=r"demands a pre-test of linear .* there is none; run"):
            started.run(tmp_path / "demanding.yaml")
        started.pre_test("linear")
        result = started.run(tmp_path / "demanding.yaml")
        assert any("passed 0.0 hours before the campaign" in remark for remark in result.status.remarks)
