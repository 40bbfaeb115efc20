"""A drive goes to a controller by its map and its response comes back, by hand; what cannot be is one sentence."""

import json
import shutil

import asammdf
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from duralab import Channel, InputError, Signals
from duralab.cli.application import app
from duralab.formats import export_drive, import_response, read_signals, write_signals
from duralab.recording import open_recording

MAP = """
rig: beam
controller: a station
sample_rate: 200
controller_rate: 512
lead: 0.5
drives:
  left: {channel: L Disp, kind: displacement, unit: mm, minimum: -50, maximum: 50, slew_limit: 2000, sign: -1,
    recorded_command: L Cmd}
  right: {channel: R Disp, kind: displacement, unit: mm, minimum: -50, maximum: 50, recorded_command: R Cmd}
responses:
  left_force: {channel: L Force, kind: force, unit: kN, minimum: -20, maximum: 20}
  right_force: {channel: R Force, kind: force, unit: kN, minimum: -20, maximum: 20, sign: -1}
channels:
  sensors: {left_force: {serial_number: F-1, calibration_date: 2020-01-01, calibration_due: 2021-01-01}}
  calculated: [{name: roll, kind: moment, weights: {left_force: 0.75 m, right_force: -0.75 m}}]
"""
PLANT = np.array([[2.0e5, 0.5e5], [-0.3e5, 1.5e5]])
"""Force in N per stroke in m."""


@pytest.fixture
def controller_map(tmp_path):
    path = tmp_path / "map.yaml"
    path.write_text(MAP)
    return path


def test_a_drive_that_moves_faster_than_the_rate_of_the_controller_holds_is_refused(tmp_path, controller_map):
    controller_map.write_text(MAP.replace("controller_rate: 512", "controller_rate: 102.4"))
    drive = noise()
    time = np.arange(drive.samples.shape[1]) / drive.sample_rate
    fast = np.stack([drive.samples[0], 0.002 * np.sin(2 * np.pi * 60.0 * time)])
    sentence = r"the map: right loses \d+\.\d % of its RMS at controller_rate 102\.4 Hz: raise it to 2\.3 times the hig"
    with pytest.raises(InputError, match=sentence):
        export_drive(Signals(drive.channels, 200.0, fast), controller_map, run="fast")
    assert not list((tmp_path / "exchange").glob("outbox/fast*"))
    # Rounding of a drive that does not move is no motion that is lost.
    slow = np.stack([drive.samples[0], 1e-16 * np.random.default_rng(5).normal(size=time.size)])
    assert export_drive(Signals(drive.channels, 200.0, slow), controller_map, run="slow").path.is_file()


def noise(seed=1, *, rate=200.0, seconds=6.0, peak=0.03):
    time = np.arange(round(rate * seconds)) / rate
    rng = np.random.default_rng(seed)
    lines = np.arange(0.5, 12.0, 0.25)
    rows = np.sin(2 * np.pi * lines[:, None] * time + rng.uniform(0, 6.28, size=(2, lines.size, 1))).sum(axis=1)
    rows *= peak / np.abs(rows).max(axis=1, keepdims=True)
    return Signals((Channel("left", "m"), Channel("right", "m")), rate, rows)


def respond(folder, run, *, gain=1.005, late=41):
    """Play a drive file on a linear plant, at its own rate, and save what a controller records; return the file."""
    played = read_signals(folder / "outbox" / f"{run}.drv")
    # A controller commands what the file says, but for its gain; acquisition began 41 samples before the drive.
    commands = np.pad(gain * played.samples, ((0, 0), (late, 100)))
    forces = PLANT @ (commands * [[-1e-3], [1e-3]]) * [[1e-3], [-1e-3]]
    channels = [
        Channel(name, unit)
        for name, unit in zip(("L Cmd", "R Cmd", "L Force", "R Force"), ("mm", "mm", "kN", "kN"), strict=True)
    ]
    path = folder / "inbox" / f"{run}.rsp"
    write_signals(Signals(tuple(channels), played.sample_rate, np.vstack([commands, forces])), path)
    return path


def invoke(*arguments):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.stdout, result.stderr


def relative_error(found, wanted):
    return np.sqrt(((found - wanted) ** 2).sum(axis=1) / (wanted**2).sum(axis=1)).max()


def test_the_response_of_an_exported_drive_is_that_of_the_plant_at_the_drives_samples(controller_map, tmp_path):
    drive = noise()
    written = export_drive(drive, controller_map, run="one")
    assert written.path == tmp_path / "exchange" / "outbox" / "one.drv"
    assert written.limit_shares == pytest.approx((0.6, 0.6))
    assert "overdue since 2021-01-01" in written.notes[0]
    assert read_signals(written.path).names == ("L Disp", "R Disp")
    found = import_response(respond(tmp_path / "exchange", "one"), controller_map)
    assert found.signals.names == ("left_force", "right_force", "roll")
    assert [channel.unit for channel in found.signals.channels] == ["N", "N", "N*m"]
    truth = PLANT @ (1.005 * drive.samples)
    truth = np.vstack([truth, 0.75 * (truth[0] - truth[1])])
    assert relative_error(found.signals.samples, truth) < 1e-3
    assert found.alignment.lag == pytest.approx(41 * 200 / 512, abs=0.01)
    assert found.alignment.gain == pytest.approx((1.005, 1.005), abs=1e-4)
    # The run has ended: its files are with those that were done, and its name is used up.
    assert not (tmp_path / "exchange" / "outbox" / "one.json").exists()
    with pytest.raises(InputError, match="run 'one' ended before"):
        export_drive(drive, controller_map, run="one")
    # What was done can be read once more.
    again = import_response(tmp_path / "exchange" / "outbox" / "done" / "one.rsp", controller_map)
    np.testing.assert_array_equal(again.signals.samples, found.signals.samples)


def test_a_drive_at_another_rate_in_the_units_and_names_of_the_controller_is_the_same_drive(controller_map, tmp_path):
    drive = noise(rate=400.0)
    theirs = Signals(
        (Channel("x", "V"), Channel("R Disp", "m"), Channel("L Disp", "mm")),
        400.0,
        np.vstack([drive.samples[:1], drive.samples[1:], -1e3 * drive.samples[:1]]),
    )
    written = export_drive(theirs, controller_map, run="one")
    assert "resampled from 400 to 200 Hz" in written.notes[0]
    found = import_response(respond(tmp_path / "exchange", "one"), controller_map)
    truth = PLANT @ (1.005 * noise().samples)
    assert relative_error(found.signals.samples[:2, 100:-100], truth[:, 100:-100]) < 1e-2


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda drive: 2.0 * drive, "left goes from -0.06 to .* are allowed"),
        (
            lambda drive: np.where(np.arange(drive.shape[1]) == 600, 0.03, 0.1 * drive),
            "left moves at .* 2 m/s are allowed",
        ),
        (
            lambda drive: np.full(drive.shape, 0.049),
            r"left moves at 3\.079 m/s in its lead of 0\.025 s, and 2 m/s are allowed: raise lead",
        ),
        (lambda drive: np.tile(drive, 700), "is 4200 s long, and the map allows 3600 s"),
    ],
)
def test_a_drive_beyond_the_map_is_refused_before_anything_is_written(controller_map, tmp_path, change, said):
    drive = noise()
    controller_map.write_text(MAP.replace("lead: 0.5", "lead: 0.025"))
    with pytest.raises(InputError, match=said):
        export_drive(Signals(drive.channels, 200.0, change(drive.samples)), controller_map, run="one")
    assert not (tmp_path / "exchange").exists()


def test_a_drive_without_the_channels_of_the_map_names_both_ways_to_give_them(controller_map):
    other = Signals((Channel("left", "m"),), 200.0, np.zeros((1, 100)))
    with pytest.raises(
        InputError, match="the map needs left, right, or by their names at the controller L Disp, R Disp"
    ):
        export_drive(other, controller_map, run="one")
    with pytest.raises(InputError, match=r"The run '\.\./one' is not a name"):
        export_drive(noise(), controller_map, run="../one")


def test_one_run_waits_until_a_person_refuses_it(controller_map, tmp_path):
    export_drive(noise(), controller_map, run="one")
    with pytest.raises(InputError, match="run 'one' waits for its response"):
        export_drive(noise(2), controller_map, run="two")
    (tmp_path / "exchange" / "inbox" / "one.refuse.txt").write_text("The clamp is open.")
    written = export_drive(noise(2), controller_map, run="two")
    assert written.notes[0] == "Run 'one' was refused at the controller: The clamp is open."
    assert (tmp_path / "exchange" / "outbox" / "done" / "one.drv").exists()


def test_the_response_of_another_run_and_a_changed_drive_file_are_refused(controller_map, tmp_path):
    exchange = tmp_path / "exchange"
    export_drive(noise(), controller_map, run="one")
    response = respond(exchange, "one")
    content = response.read_bytes()
    import_response(response, controller_map)
    export_drive(noise(), controller_map, run="two")
    same = tmp_path / "two.rsp"
    same.write_bytes(content)
    with pytest.raises(InputError, match="it is the response of run 'one'"):
        import_response(same, controller_map)
    (exchange / "inbox" / "two.refuse.txt").write_text("again")
    export_drive(noise(3), controller_map, run="three")
    with pytest.raises(InputError, match=r"correlation|record of another run"):
        import_response(same, controller_map, run="three")
    drive_file = exchange / "outbox" / "three.drv"
    drive_file.write_bytes(drive_file.read_bytes()[:-1] + b"\1")
    with pytest.raises(InputError, match="its SHA-256 is"):
        import_response(same, controller_map, run="three")
    with pytest.raises(InputError, match="No drive of run 'four' was written"):
        import_response(same, controller_map, run="four")


def test_a_map_that_cannot_be_is_refused_with_its_path(controller_map):
    controller_map.write_text(MAP.replace("channel: R Disp", "channel: L Disp"))
    with pytest.raises(InputError, match=r"map\.yaml: .*one-to-one"):
        export_drive(noise(), controller_map, run="one")


def test_the_commands_write_a_drive_and_read_its_response(controller_map, tmp_path):
    write_signals(noise(), tmp_path / "road.drv", data_type="floating_point")
    code, out, err = invoke("export", "--map", controller_map, tmp_path / "road.drv")
    assert (code, err) == (0, "")
    assert "exchange/outbox/road.drv: " in out
    assert "L Disp: peak 30" in out
    assert "60 % of its limit; full scale 50 mm" in out
    assert "waits for inbox/road.rsp" in out
    response = respond(tmp_path / "exchange", "road")
    code, out, err = invoke("import", "--map", controller_map, response, tmp_path / "road.csv", "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["run"] == "road"
    assert document["alignment"]["gain"] == pytest.approx([1.005, 1.005], abs=1e-4)
    assert read_signals(tmp_path / "road.csv").names == ("left_force", "right_force", "roll")


def test_what_is_not_read_of_an_exported_drive_file_is_named(controller_map, tmp_path):
    drive = noise()
    with asammdf.MDF(version="4.10") as measurement:
        time = np.arange(drive.samples.shape[1]) / drive.sample_rate
        rows = [(channel.name, row, channel.unit) for channel, row in zip(drive.channels, drive.samples, strict=True)]
        rows.append(("gear", np.full(time.size, b"D"), ""))
        measurement.append(
            [asammdf.Signal(row, time, name=name, unit=unit, encoding="utf-8") for name, row, unit in rows]
        )
        measurement.save(tmp_path / "road.mf4")
    sentence = "Channels that are not real numbers are left out: gear."
    _, out, _ = invoke("export", "--map", controller_map, tmp_path / "road.mf4")
    assert sentence in out.splitlines()
    shutil.rmtree(tmp_path / "exchange")
    _, out, _ = invoke("export", "--map", controller_map, tmp_path / "road.mf4", "--json")
    assert sentence in json.loads(out)["notes"]


def test_a_playback_of_a_recording_goes_out_to_the_controller(recording_path, tmp_path):
    recorded = open_recording(recording_path).playback(1).drive
    drives = {
        channel.name: {"channel": f"{channel.name} Cyl", "kind": "displacement", "unit": "mm", "minimum": -500.0,
                       "maximum": 500.0}
        for channel in recorded.channels
    }  # fmt: skip
    response = {"channel": "Force", "kind": "force", "unit": "N", "minimum": -1.0, "maximum": 1.0}
    content = {"rig": "axle", "sample_rate": recorded.sample_rate, "drives": drives, "responses": {"force": response}}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    code, out, err = invoke("export", "--map", tmp_path / "map.yaml", recording_path, "--playback", 1, "--run", "one")
    assert (code, err) == (0, "")
    assert "It is playback 1 of" in out
    written = read_signals(tmp_path / "exchange" / "outbox" / "one.drv").samples
    lead = round(2.0 * recorded.sample_rate)
    # Half a step of 16 bits over the limit of 500 mm.
    np.testing.assert_allclose(written[:, lead:-lead], 1e3 * recorded.samples, atol=0.51 * 500 / 32752)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("export", "--map", "MAP", "road.drv", "out.drv"), "OUT is given beside --map"),
        (("export", "--map", "MAP", "road.drv", "--unit", "mm"), "--unit is given beside --map"),
        (("export", "--map", "MAP", "road.drv", "--what", "target"), "a controller takes a drive"),
        (("export", "--map", "MAP", "road.drv", "--playback", "2"), "is no recording"),
        (("export", "road.mcap"), "OUT is missing"),
        (("export", "road.mcap", "out.drv", "--run", "one"), "--run goes with --map"),
        (("import", "--map", "MAP", "road.rsp", "out.csv", "--rig", "beam"), "--rig is given beside --map"),
        (("import", "road.rsp", "out.csv"), "--rig is missing"),
        (("import", "road.rsp", "out.csv", "--rig", "beam", "--run", "one"), "--run goes with --map"),
    ],
)
def test_options_that_do_not_go_together_are_refused(controller_map, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    write_signals(noise(), tmp_path / "road.drv")
    code, _, err = invoke(*(controller_map if argument == "MAP" else argument for argument in arguments))
    assert code == 2
    assert said in err
