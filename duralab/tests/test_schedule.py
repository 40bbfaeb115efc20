"""Schedules from recordings and drive files: designed, forecast, refused, written."""

import json
import shutil
from contextlib import nullcontext
from types import SimpleNamespace

import asammdf
import numpy as np
import pytest
import synthetic_campaign
from test_cli import invoke

import duralab
from duralab import Channel, Signals, open_recording
from duralab.data import Rig
from duralab.formats import write_signals
from duralab.lab.endurance import EnduranceProgress, EnduranceTest, start_endurance
from duralab.schedule import schedule_text
from duralab_loads import channel_damage
from duralab_proto.arrays import from_array
from duralab_proto.keys import Keys
from duralab_proto.v1 import sequencer_pb2

RIG = "front_axle"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two campaigns on one rig, rough and smooth, and a schedule that plays them."""
    folder = tmp_path_factory.mktemp("events")
    for name, seed in (("rough", 3), ("smooth", 4)):
        campaign = synthetic_campaign.make(seconds=8.0, iterations=4, seed=seed)
        (folder / name).mkdir()
        synthetic_campaign.write(folder / name / "recording.mcap", synthetic_campaign.steps(campaign))
    return folder


def schedule(folder, text="", name="weeks.yaml", **events):
    events = events or {"rough": "repeats: 400", "smooth": "repeats: 100"}
    lines = [f"  {event}: {{drive: {event}, missed_target_accepted: true, {more}}}" for event, more in events.items()]
    path = folder / name
    path.write_text("\n".join([f"name: weeks\nrig: {RIG}\nevents:", *lines, text]))
    return path


def damage(folder, event, *, exponent=5.0):
    recording = open_recording(folder / event / "recording.mcap")
    table = recording.iterations
    response = recording.playback(table.numbers[table.best]).response
    return channel_damage(response.samples, exponents=[exponent])[:, 0]


def target_damage(folder, event, exponent=5.0):
    given = open_recording(folder / event / "recording.mcap").specification.target
    return channel_damage(Signals.from_message(given).samples, exponents=[exponent])[:, 0]


def test_the_damage_of_a_schedule_is_that_of_the_measured_responses(folder):
    found = duralab.forecast_schedule(duralab.load_schedule(schedule(folder)))
    expected = 400 * damage(folder, "rough") + 100 * damage(folder, "smooth")
    np.testing.assert_allclose(list(found.forecast.damage.values()), expected, rtol=1e-12)
    assert tuple(found.forecast.damage) == synthetic_campaign.NAMES
    assert found.forecast.seconds == 500 * 8.0
    assert found.forecast.kept == {"rough": 3, "smooth": 3}
    assert found.forecast.sample_bytes == 2 * 8000 * 6 * 8 + 6 * round(8000 * 12 * 8 * 1.1)
    found.require_playable(free_bytes=10**9)
    assert "500 repeats in 1:06:40 of playing" in str(found)


def test_the_planned_damage_of_an_endurance_test_is_that_of_the_forecast(folder):
    given = duralab.load_schedule(schedule(folder))
    found = duralab.forecast_schedule(given)
    asked = []
    ask = SimpleNamespace(bus=SimpleNamespace(keys=Keys()), query=lambda _key, spec, _answer: asked.append(spec))
    rig = Rig.from_message(synthetic_campaign.description())
    start_endurance(ask, rig, given, id="weeks", seed=1, real_time=False, recordings=None)
    each = [from_array(event.planned_damage, field="planned_damage") for event in asked[0].events]
    np.testing.assert_allclose(each, [damage(folder, "rough"), damage(folder, "smooth")], rtol=1e-12)
    np.testing.assert_allclose([400, 100] @ np.array(each), list(found.forecast.damage.values()), rtol=1e-12)


def test_a_started_endurance_test_has_the_notes_on_its_schedule(folder):
    given = duralab.load_schedule(schedule(folder, rough="repeats: 400", smooth="repeats: 5"))
    ask = SimpleNamespace(bus=SimpleNamespace(keys=Keys()), query=lambda *_: None)
    rig = Rig.from_message(synthetic_campaign.description())
    test = start_endurance(ask, rig, given, id="weeks", seed=1, real_time=False, recordings=None)
    assert test.notes == duralab.forecast_schedule(given).notes
    assert "smooth (5) has no more, so no change is detected in it." in test.notes[0]


def test_the_command_that_starts_an_endurance_test_says_the_notes(folder, monkeypatch):
    test = EnduranceTest(None, "weeks", RIG, notes=("No change is detected in smooth.",))
    playing = sequencer_pb2.ENDURANCE_PHASE_PLAYING
    status = sequencer_pb2.EnduranceStatus(id="weeks", rig=RIG, phase=playing, activity="starting")
    progress = EnduranceProgress.from_message(status)
    monkeypatch.setattr(EnduranceTest, "progress", lambda _: progress)
    lab = nullcontext(SimpleNamespace(endure=lambda *_, **__: test))
    monkeypatch.setattr("duralab.lab.connect", lambda _: lab)
    code, said, _ = invoke("endurance", "start", schedule(folder), "--connect", "tcp/127.0.0.1:1")
    assert code == 0
    assert said.splitlines()[:2] == ["No change is detected in smooth.", f"Endurance test weeks on {RIG}: starting"]


def test_a_design_finds_the_mix_that_the_plan_was_made_of(folder):
    planned = 321 * damage(folder, "rough", exponent=3.0) + 123 * damage(folder, "smooth", exponent=3.0)
    values = ", ".join(f"{name}: {value:.17g}" for name, value in zip(synthetic_campaign.NAMES, planned, strict=True))
    path = schedule(
        folder,
        f"monitoring: {{damage_exponent: 3}}\nplan: {{damage: {{{values}}}}}",
        rough="at_most: 1000",
        smooth="at_least: 1",
    )
    found = duralab.design_schedule(duralab.load_schedule(path))
    assert found.forecast.repeats == {"rough": 321, "smooth": 123}
    assert found.misfit < 1e-9
    np.testing.assert_allclose(list(found.forecast.ratio.values()), 1.0, atol=1e-9)


def test_a_customers_mix_counts_the_targets(folder):
    path = schedule(
        folder,
        "plan: {mix: {rough: {count: 300.0}, smooth: {count: 50.0}}}",
        rough="at_least: 0",
        smooth="repeats: 60",
    )
    found = duralab.design_schedule(duralab.load_schedule(path))
    contained = found.self_contained
    assert contained.plan.damage == found.planned
    assert contained.repeats == found.forecast.repeats
    expected = 300 * target_damage(folder, "rough") + 50 * target_damage(folder, "smooth")
    np.testing.assert_allclose(list(found.planned.values()), expected, rtol=1e-12)
    assert found.forecast.repeats["smooth"] == 60
    each = damage(folder, "rough") / expected
    rest = 1.0 - 60 * damage(folder, "smooth") / expected
    assert found.forecast.repeats["rough"] == round(each @ rest / (each @ each))


def test_a_mix_may_name_the_target_file_of_an_event_that_is_not_played(folder):
    recording = open_recording(folder / "smooth" / "recording.mcap")
    write_signals(Signals.from_message(recording.specification.target), folder / "city.csv", overwrite=True)
    text = "plan: {mix: {city: {count: 50.0, target: city.csv}}}"
    found = duralab.design_schedule(duralab.load_schedule(schedule(folder, text, smooth="at_most: 9999")))
    # As text, the file holds fewer digits.
    np.testing.assert_allclose(list(found.planned.values()), 50 * target_damage(folder, "smooth"), rtol=1e-6)


def test_a_drive_file_has_the_damage_of_its_target(folder):
    drive = Signals(tuple(Channel(name, "m") for name in synthetic_campaign.NAMES), 1000.0, np.zeros((6, 500)))
    load = Signals(
        tuple(Channel(name, "N") for name in synthetic_campaign.NAMES), 1000.0, np.tile([0.0, 2.0], (6, 250))
    )
    write_signals(drive, folder / "drive.csv", overwrite=True)
    write_signals(load, folder / "load.csv", overwrite=True)
    path = folder / "files.yaml"
    text = f"name: files\nrig: {RIG}\nevents:\n  square: {{drive: drive.csv, repeats: 10, TARGET}}\n"
    path.write_text(text.replace("TARGET", "target: load.csv"))
    found = duralab.forecast_schedule(duralab.load_schedule(path)).forecast
    np.testing.assert_allclose(list(found.damage.values()), 10 * channel_damage(load.samples, exponents=[5.0])[:, 0])
    path.write_text(text.replace(", TARGET", ""))
    found = duralab.forecast_schedule(duralab.load_schedule(path))
    assert found.forecast.unknown_damage == ("square",)
    assert "The damage of square is not known and not counted." in str(found)


def test_what_is_not_read_of_the_files_of_a_schedule_is_named(folder):
    time, rows = np.arange(500) / 1000, [(name, np.zeros(500), "m") for name in synthetic_campaign.NAMES]
    with asammdf.MDF(version="4.10") as measurement:
        rows.append(("gear", np.full(500, b"D"), ""))
        measurement.append(
            [asammdf.Signal(row, time, name=name, unit=unit, encoding="utf-8") for name, row, unit in rows]
        )
        measurement.save(folder / "drive.mf4", overwrite=True)
    path = folder / "text.yaml"
    path.write_text(
        f"name: files\nrig: {RIG}\nevents:\n  square: {{drive: drive.mf4, target: drive.mf4, repeats: 10}}\n"
        "plan: {mix: {square: {count: 1.0}, city: {count: 5.0, target: drive.mf4}}}\n"
    )
    found = duralab.forecast_schedule(duralab.load_schedule(path))
    said = "that are not real numbers are left out: gear"
    assert f"file drive.mf4 (channels {said}) (channels of drive.mf4 {said})" in str(found)
    assert found.notes[0] == f"plan.mix.city: channels of drive.mf4 {said}."


def loads_of(folder, name, *, units, scale=1.0):
    """Write an event's drive in millimetres and its target in given units; return the schedule's line of it."""
    names, rng = synthetic_campaign.NAMES, np.random.default_rng(len(name))
    drive = Signals(tuple(Channel(each, "mm") for each in names), 1000.0, rng.normal(size=(6, 500)))
    target = Signals(tuple(map(Channel, names, units)), 1000.0, scale * rng.normal(size=(6, 500)))
    write_signals(drive, folder / f"{name}_drive.csv", overwrite=True)
    write_signals(target, folder / f"{name}_target.csv", overwrite=True)
    return f"  {name}: {{drive: {name}_drive.csv, target: {name}_target.csv, repeats: 10}}\n"


def test_files_in_other_units_have_the_same_damage_and_drives_in_metres(folder):
    head = f"name: files\nrig: {RIG}\nevents:\n"
    path = folder / "units.yaml"
    found = []
    for unit, scale in (("N", 1000.0), ("kN", 1.0)):
        path.write_text(head + loads_of(folder, "town", units=[unit] * 6, scale=scale))
        found.append(duralab.forecast_schedule(duralab.load_schedule(path)))
    np.testing.assert_allclose(list(found[1].forecast.damage.values()), list(found[0].forecast.damage.values()))
    drive = found[1].events["town"].drive
    assert {channel.unit for channel in drive.channels} == {"m"}
    assert 1e-3 < np.max(np.abs(drive.samples)) < 1e-2


def test_events_whose_responses_have_units_of_two_kinds_are_refused(folder):
    path = folder / "units.yaml"
    path.write_text(
        f"name: files\nrig: {RIG}\nevents:\n"
        + loads_of(folder, "town", units=["N"] * 6)
        + loads_of(folder, "hills", units=["N"] * 5 + ["m/s^2"])
    )
    last = synthetic_campaign.NAMES[-1]
    with pytest.raises(duralab.InputError, match=f"{last} of event hills is in m/s.2 and that of town in N; give "):
        duralab.forecast_schedule(duralab.load_schedule(path))


def test_a_target_without_units_is_refused(folder):
    path = folder / "units.yaml"
    path.write_text(f"name: files\nrig: {RIG}\nevents:\n" + loads_of(folder, "town", units=["N"] * 5 + [""]))
    with pytest.raises(duralab.InputError, match=r"Event town: town_target.csv.* names no unit"):
        duralab.forecast_schedule(duralab.load_schedule(path))


def test_a_designed_schedule_is_written_and_read_as_the_same(folder, tmp_path):
    path = schedule(
        folder,
        "order: shuffled\nseed: 5\nplan: {mix: {rough: {count: 300.0}}}",
        rough="at_most: 900",
        smooth="at_least: 2",
    )
    out = tmp_path / "designed.yaml"
    code, stdout, stderr = invoke("schedule", "design", path, "--out", out)
    assert code == 0, stderr
    assert "Planned damage over the damage plan differs from 1 by" in stdout
    written, designed = duralab.load_schedule(out), duralab.design_schedule(duralab.load_schedule(path))
    assert written.repeats == designed.forecast.repeats
    assert np.array_equal(written.sequence(), designed.schedule.sequence())
    assert duralab.forecast_schedule(written).forecast == designed.forecast
    assert schedule_text(written, folder=tmp_path) == schedule_text(designed.schedule, folder=tmp_path)
    code, _, stderr = invoke("schedule", "design", path, "--out", out)
    assert code == 2
    assert "would be overwritten" in stderr


def test_show_prints_the_forecast_and_as_json_one_document(folder):
    path = schedule(folder)
    code, stdout, stderr = invoke("schedule", "show", path)
    assert code == 0, stderr
    assert "playback 3 of demo" in stdout
    code, stdout, _ = invoke("schedule", "show", path, "--json")
    assert code == 0
    told = json.loads(stdout)
    assert told["repeats"] == {"rough": 400, "smooth": 100}
    assert told["bytes"] == told["sample_bytes"] + told["statistics_bytes"]


def test_an_event_whose_repeats_are_all_taken_for_its_baseline_is_named(folder):
    def notes(rough, smooth, text="monitoring: {baseline_repeats: 8}"):
        given = schedule(folder, text, rough=f"repeats: {rough}", smooth=f"repeats: {smooth}")
        return duralab.forecast_schedule(duralab.load_schedule(given)).notes

    assert notes(9, 400) == ()
    (note,) = notes(8, 400)
    assert note.startswith("The baseline of an event is learnt from its first 8 repeats")
    assert note.endswith("rough (8) has no more, so no change is detected in it.")
    assert "rough (10), smooth (4) has no more" in notes(10, 4, "")[0]


def test_a_recording_is_found_by_its_id(folder, tmp_path):
    shutil.copy(folder / "rough" / "recording.mcap", tmp_path / "rough-1.mcap")
    path = tmp_path / "ids.yaml"
    path.write_text(
        f"name: ids\nrig: {RIG}\nevents: {{rough: {{drive: rough-1, repeats: 2, missed_target_accepted: true}}}}"
    )
    code, stdout, stderr = invoke("schedule", "show", path, "--recordings", tmp_path)
    assert code == 0, stderr
    assert "2 repeats" in stdout
    code, _, stderr = invoke("schedule", "show", path)
    assert code == 2
    assert "Event rough: there is no drive" in stderr


@pytest.mark.parametrize(
    ("text", "events", "sentence"),
    [
        ("rig: front_axle", {"town": "repeats: 1"}, "Event town: there is no drive"),
        ("", {"rough": "repeats: 1, target: a.csv"}, "target is a.csv; the recording"),
        ("plan: {damage: {middle: 1.0}}", {}, "plan.damage names middle; the responses are left_vertical"),
        ("plan: {mix: {town: {count: 1.0}}}", {}, "plan.mix names the unknown event 'town'"),
        (
            "plan: {damage: {left_vertical: 1.0}}",
            {},
            "times the damage of its plan into left_vertical, and 1.5 is allowed",
        ),
    ],
)
def test_what_must_not_be_played_is_refused_in_one_sentence(folder, text, events, sentence):
    path = schedule(folder, text if not text.startswith("rig") else "", **events)
    code, _, stderr = invoke("schedule", "show", path)
    assert code == 2
    assert sentence in stderr
    assert len(stderr.strip().splitlines()) == 1


def test_a_recording_that_missed_its_target_or_is_of_another_rig_is_refused(folder):
    path = schedule(folder)
    text = path.read_text()
    path.write_text(text.replace(", missed_target_accepted: true", ""))
    with pytest.raises(duralab.InputError, match=r"Event rough: the recording .* missed its target \("):
        duralab.forecast_schedule(duralab.load_schedule(path))
    path.write_text(text.replace(f"rig: {RIG}", "rig: rear_axle"))
    with pytest.raises(duralab.InputError, match="is of the rig front_axle, and the schedule of rear_axle"):
        duralab.forecast_schedule(duralab.load_schedule(path))


@pytest.mark.parametrize(
    ("text", "events", "sentence"),
    [
        ("", {"rough": "at_least: 1"}, "The schedule has no plan"),
        ("plan: {damage: {left_vertical: 1.0}}", {"rough": "repeats: 1"}, "Every event has repeats"),
        (
            "plan: {damage: {left_vertical: 1.0}}\norder: nested\nblocks: [{events: {rough: 1}}]",
            {"rough": "at_least: 1"},
            "The order is nested, and blocks set the repeats",
        ),
    ],
)
def test_what_cannot_be_designed_is_refused(folder, text, events, sentence):
    with pytest.raises(duralab.InputError, match=sentence):
        duralab.design_schedule(duralab.load_schedule(schedule(folder, text, **events)))


def test_a_schedule_longer_than_the_disk_holds_is_refused(folder):
    found = duralab.forecast_schedule(duralab.load_schedule(schedule(folder)))
    with pytest.raises(duralab.InputError, match=r"The recording takes .* and 1 MB are free"):
        found.require_playable(free_bytes=10**6)
