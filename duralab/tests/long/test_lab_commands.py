"""Commands that ask the lab that runs: --connect left out, JSON, files checked before anything moves."""

import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import synthetic_campaign
import yaml
from ended_processes import wait_until_gone
from fake_lab import response_to
from test_cli import finish, invoke, start_up
from test_foreign_files import mdf

from duralab import Channel, Signals
from duralab.formats import read_frequency_response, read_signals, write_signals

HERE = Path(__file__).parents[1]
NAMES = synthetic_campaign.NAMES


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A lab of fakes that `duralab up` keeps running, the only one of its user."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        patch.setenv("PYTHONPATH", f"{HERE / 'fakes'}:{HERE}")
        process, endpoint, pids = start_up(tmp_path_factory.mktemp("up"))
        yield process, endpoint, pids
        if process.poll() is None:
            process.terminate()
            with suppress(Exception):
                finish(process)


@pytest.fixture
def drive(tmp_path):
    """A drive with the channels in another order and in millimetres."""
    time = np.arange(2000) / 1000
    rows = np.array([10.0 * (number + 1) * np.sin(2 * np.pi * 2 * time) for number in range(6)])
    path = tmp_path / "drive.csv"
    channels = tuple(Channel(name, "mm") for name in reversed(NAMES))
    write_signals(Signals(channels, 1000.0, rows), path)
    return path, rows[::-1] / 1000


def test_status_shows_rigs_their_states_and_the_recorders_disk(lab):
    code, stdout, stderr = invoke("status")
    assert code == 0, stderr
    assert "interlocked" in stdout
    # Word for word: it is no markup of the table.
    assert "A hose [/left] is loose." in stdout
    assert "No campaign is under way." in stdout
    code, stdout, _ = invoke("status", "--json")
    (told,) = json.loads(stdout)["labs"]
    assert (told["endpoint"], told["whole"], told["missing"]) == (lab[1], True, [])
    assert [(rig["rig"], rig["mode"]) for rig in told["rigs"]] == [
        ("front_axle", "idle"),
        ("predecessor", "interlocked"),
    ]
    assert told["recorder"]["free_bytes"] > 0


def test_rigs_of_the_lab_that_runs_are_listed(lab):
    code, stdout, _ = invoke("rigs", "--json")
    assert code == 0
    told = json.loads(stdout)
    assert told["lab"] == lab[1]
    first = told["rigs"][0]
    assert (first["name"], first["sample_rate"]) == ("front_axle", 1000.0)
    assert first["drives"][0] == {
        "name": "left_vertical",
        "unit": "m",
        "minimum": -0.125,
        "maximum": 0.125,
        "slew_limit": 2.0,
        "actuator_speed": None,
        "label": "left_vertical actuator",
        "holds_static": False,
        "ac_coupled": False,
    }


@pytest.mark.parametrize("suffix", [".csv", ".rsp", ".mf4"])
def test_a_drive_file_is_played_and_its_response_written(lab, drive, tmp_path, suffix):
    path, metres = drive
    out = tmp_path / f"response{suffix}"
    code, stdout, stderr = invoke("play", "front_axle", path, "--out", out, "--json")
    assert code == 0, stderr
    told = json.loads(stdout)
    assert (told["rig"], told["seconds"]) == ("front_axle", 2.0)
    response = read_signals(out)
    wanted = response_to(metres)
    np.testing.assert_allclose(response.samples[:, :2000], wanted, atol=1e-3 * np.abs(wanted).max())
    assert told["channels"][0]["peak"] == pytest.approx(np.abs(wanted[0]).max())


def test_text_that_is_left_out_of_a_drive_file_is_named(lab, drive, tmp_path):
    given = read_signals(drive[0])
    time = np.arange(2000) / 1000
    numbers = [(name, time, row) for name, row in zip(given.names, given.samples, strict=True)]
    path = mdf(tmp_path, [*numbers, ("gear", time, np.full(2000, b"D"))])
    units = [part for name in given.names for part in ("--unit", f"{name}=mm")]
    note = "Channels that are not real numbers are left out: gear."
    code, stdout, stderr = invoke("play", "front_axle", path, *units)
    assert code == 0, stderr
    assert note in stdout
    code, stdout, _ = invoke("play", "front_axle", path, *units, "--replace", "--json")
    assert json.loads(stdout)["notes"] == [note]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda s: Signals(s.channels[:5], 1000.0, s.samples[:5]), "lacks left_vertical"),
        (lambda s: Signals((Channel("odd", "mm"), *s.channels[1:]), 1000.0, s.samples), "has odd besides"),
        (lambda s: Signals(s.channels, 500.0, s.samples), "--rate 1000"),
        (lambda s: Signals((Channel(s.channels[0].name, "kN"), *s.channels[1:]), 1000.0, s.samples), "kN"),
    ],
)
def test_a_drive_that_does_not_fit_the_rig_is_refused_and_nothing_written(lab, drive, tmp_path, change, said):
    path = tmp_path / "wrong.csv"
    write_signals(change(read_signals(drive[0])), path)
    code, _, stderr = invoke("play", "front_axle", path)
    assert code == 2
    assert said in stderr
    assert not (tmp_path / "wrong_response.csv").exists()


def unnamed(path, drive, *, of):
    """Write the drive again, without the units of some channels."""
    given = read_signals(drive)
    channels = tuple(Channel(c.name, "" if c.name in of else c.unit) for c in given.channels)
    write_signals(Signals(channels, given.sample_rate, given.samples), path)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".rsp"])
def test_a_drive_without_units_is_refused_and_played_in_those_a_person_states(lab, drive, tmp_path, suffix):
    some, none = NAMES[1:3], NAMES
    path = unnamed(tmp_path / f"some{suffix}", drive[0], of=some)
    code, _, stderr = invoke("play", "front_axle", path)
    assert code == 2
    assert f"names no unit for {', '.join(some)}, " in stderr
    assert "converts to m is allowed" in stderr
    assert not (tmp_path / "some_response.csv").exists()
    wanted = response_to(drive[1])
    for file, units in (
        (path, ("--unit", "mm")),
        (path, ("--unit", f"{some[0]}=mm", "--unit", f"{some[1]}=mm")),
        (unnamed(tmp_path / f"none{suffix}", drive[0], of=none), ("--unit", "mm")),
    ):
        code, _, stderr = invoke("play", "front_axle", file, *units, "--out", tmp_path / "r.csv", "--replace")
        assert code == 0, stderr
        played = read_signals(tmp_path / "r.csv").samples[:, :2000]
        np.testing.assert_allclose(played, wanted, atol=1e-3 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("units", "said"),
    [
        (("m",), "shows the unit of every drive"),
        (("odd=m",), "--unit names odd; the drives"),
        (("m", "mm"), "--unit gives m and mm for all"),
        ((f"{NAMES[0]}=kN",), "cannot be converted to 'm'"),
        ((f"{NAMES[0]}=",), "names no unit"),
    ],
)
def test_a_unit_that_fits_no_drive_is_refused(lab, drive, tmp_path, units, said):
    code, _, stderr = invoke("play", "front_axle", drive[0], *(part for unit in units for part in ("--unit", unit)))
    assert code == 2
    assert said in stderr


def test_a_response_in_the_way_is_said_before_anything_moves(lab, drive, tmp_path):
    (tmp_path / "drive_response.csv").write_text("mine")
    code, _, stderr = invoke("play", "front_axle", drive[0])
    assert code == 2
    assert "would be overwritten" in stderr
    assert (tmp_path / "drive_response.csv").read_text() == "mine"
    code, _, stderr = invoke("play", "front_axle", drive[0], "--out", tmp_path / "r.wav")
    assert code == 2
    assert "'.wav'" in stderr


def test_an_identification_shows_its_model_and_writes_it(lab, tmp_path):
    out = tmp_path / "model.uff"
    code, stdout, stderr = invoke("identify", "front_axle", "--settings", "front_axle_demo", "--out", out, "--json")
    assert code == 0, stderr
    told = json.loads(stdout)
    assert [response["name"] for response in told["responses"]] == list(NAMES)
    assert 0.0 < told["responses"][0]["median_coherence"] <= 1.0
    found = read_frequency_response(out)
    assert len(found.frequency) == told["lines"]


def test_settings_of_an_identification_are_two_sections(lab, tmp_path):
    from importlib.resources import files

    campaign = yaml.safe_load((files("duralab.campaign") / "shipped" / "front_axle_demo.yaml").read_text())
    sections = {name: campaign[name] for name in ("excitation", "estimator")}
    path = tmp_path / "settings.yaml"
    path.write_text(yaml.safe_dump(sections))
    assert invoke("identify", "front_axle", "--settings", path)[0] == 0
    sections["excitation"]["durration"] = 3
    path.write_text(yaml.safe_dump(sections))
    code, _, stderr = invoke("identify", "front_axle", "--settings", path)
    assert code == 2
    assert "unknown key 'durration' in excitation" in stderr
    code, _, stderr = invoke("identify", "front_axle", "--settings", "front_axle_demo", "--out", tmp_path / "m.csv")
    assert code == 2
    assert "cannot hold a frequency response" in stderr


def test_a_measured_file_becomes_a_target_and_each_step_is_told(lab, tmp_path):
    time = np.arange(3000) / 500
    rows = np.array([np.sin(2 * np.pi * 3 * time + number) for number in range(6)])
    source, out, settings = tmp_path / "road.csv", tmp_path / "target.csv", tmp_path / "map.yaml"
    write_signals(Signals(tuple(Channel(f"F{number}", "kN") for number in range(6)), 500.0, rows), source)
    mapping = {name: {"from": f"F{number}", "scale": -1} for number, name in enumerate(NAMES)}
    settings.write_text(yaml.safe_dump({"channels": mapping, "edit": [{"resample": {"rate": 1000}}]}))
    code, stdout, stderr = invoke("import", source, out, "--rig", "front_axle", "--settings", settings, "--json")
    assert code == 0, stderr
    told = json.loads(stdout)
    assert (told["seconds"], [step["name"] for step in told["steps"]]) == (6.0, ["read_file", "resample"])
    target = read_signals(out)
    assert (target.names, target.channels[0].unit, target.sample_rate) == (NAMES, "N", 1000.0)
    wanted = -1000.0 * np.sin(2 * np.pi * 3 * target.time + 2)
    np.testing.assert_allclose(target.samples[2, 500:5500], wanted[500:5500], atol=1.0)
    assert invoke("import", source, out, "--rig", "front_axle", "--settings", settings)[0] == 2
    code, _, stderr = invoke("import", source, tmp_path / "b.csv", "--rig", "front_axle")
    assert code == 2
    assert "lacks left_vertical" in stderr
    settings.write_text("chanels: {}")
    code, _, stderr = invoke("import", source, tmp_path / "b.csv", "--rig", "front_axle", "--settings", settings)
    assert "did you mean 'channels'?" in stderr


def test_a_campaign_is_stopped_in_the_lab_that_runs(lab):
    code, _, stderr = invoke("stop", "nobody")
    assert code in (1, 2)
    assert "Traceback" not in stderr


def test_down_ends_the_lab_with_everything_it_started(lab):
    process, endpoint, pids = lab
    code, stdout, stderr = invoke("down")
    assert code == 0, stderr
    assert stdout == f"The lab at {endpoint} is down.\n"
    # How it ended was asked by `down`, in this process: only that it did is left to be seen.
    assert finish(process)[0] is not None
    assert wait_until_gone(pids, seconds=0.0) == []
    code, stdout, _ = invoke("status")
    assert code == 1
    assert "`duralab up` starts one" in stdout
