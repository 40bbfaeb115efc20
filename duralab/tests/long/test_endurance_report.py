"""The recordings of an endurance test: read as one, trends as the monitor sees them, the report of all of it."""

import html
import json
import re
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
import synthetic_endurance
import yaml
from test_cli import invoke

from duralab import InputError, open_recording
from duralab.analysis import damage_plan, damage_so_far, deviations, planned_so_far, planned_total
from duralab.recording import EnduranceRecording
from duralab.report import write_report
from duralab_monitoring import AlarmKind, Statistic
from duralab_proto.arrays import to_array
from duralab_proto.v1 import sequencer_pb2


@pytest.fixture(scope="module")
def made():
    return synthetic_endurance.make()


@pytest.fixture(scope="module")
def first(made, tmp_path_factory):
    return synthetic_endurance.write(tmp_path_factory.mktemp("endurance"), made)


@pytest.fixture(scope="module")
def recording(first):
    return EnduranceRecording(first)


@pytest.fixture(scope="module")
def page(first, tmp_path_factory):
    return write_report(first, tmp_path_factory.mktemp("report") / "report.html").read_text(encoding="utf-8")


def test_all_recordings_of_a_test_are_read_as_one_whichever_is_given(made, first, recording):
    other = EnduranceRecording(first.with_name("weeks-v0003.mcap"))
    assert [path.name for path in recording.files] == ["weeks.mcap", "weeks-v0002.mcap", "weeks-v0003.mcap"]
    assert other.files == recording.files
    repeats = recording.repeats
    assert repeats.repeat.tolist() == list(range(120))
    assert np.array_equal(repeats.event, made.sequence)
    np.testing.assert_array_equal(repeats.statistics, np.array(made.statistics, dtype=np.float32))
    assert np.flatnonzero(~repeats.known).tolist() == [made.unknown]
    assert recording.schedule.repeats == {"rough": 80, "smooth": 40}


def test_kept_samples_are_those_that_were_played(made, recording):
    kept = recording.repeats.repeat[recording.repeats.kept]
    # The first two, and every 20th; and those with an alarm.
    by_rule = [
        r for name in (0, 1) for n, r in enumerate(np.flatnonzero(made.sequence == name)) if n < 2 or n % 20 == 0
    ]
    assert set(by_rule) - {made.unknown} <= set(kept.tolist())
    for repeat in kept.tolist():
        np.testing.assert_array_equal(recording.response(repeat).samples, made.responses[repeat])
    missing = int(np.flatnonzero(~recording.repeats.kept)[0])
    assert recording.response(missing) is None


def test_damage_adds_up_and_what_is_not_known_counts_as_planned(made, recording):
    damage = [table[:, list(Statistic).index("damage")] for table in made.statistics]
    damage[made.unknown] = recording.planned_damage[made.sequence[made.unknown]]
    np.testing.assert_allclose(damage_so_far(recording), np.cumsum(damage, axis=0), rtol=1e-12)
    np.testing.assert_allclose(planned_total(recording), [80, 40] @ recording.planned_damage)
    np.testing.assert_allclose(planned_so_far(recording), planned_total(recording))


def test_the_damage_of_a_correction_counts_after_the_repeat_before_it_and_is_shown(tmp_path):
    made = synthetic_endurance.make()
    sentence = "2 playbacks of campaign weeks-rough-1 count with their damage."
    part = np.array([1e20, 0.0, 0.0, 0.0, 0.0, 0.0])
    place = next(n for n, step in enumerate(made.volumes[1]) if getattr(step, "repeat", None) == 71)
    correction = sequencer_pb2.EnduranceCorrection(
        campaign="weeks-rough-1", playbacks=2, damage=to_array(part), reason=sentence, next_repeat=71
    )
    without = damage_so_far(EnduranceRecording(synthetic_endurance.write(tmp_path, made)))
    made.volumes[1].insert(place, correction)
    (tmp_path / "again").mkdir()
    recording = EnduranceRecording(synthetic_endurance.write(tmp_path / "again", made))
    expected = without + np.outer(np.arange(120) >= 70, part)
    np.testing.assert_allclose(damage_so_far(recording), expected)
    page = write_report(recording.path, tmp_path / "report.html").read_text(encoding="utf-8")
    assert sentence in page
    assert "of it by corrections" in page
    assert f"<td>{expected[-1, 0]:.3g}</td>" in page
    assert "<td>1e+20</td>" in page


def test_the_damage_plan_of_the_schedule_is_shown_beside_the_planned_damage_of_its_repeats(tmp_path, page):
    assert "damage plan" not in page
    planned = dict.fromkeys(synthetic_endurance.NAMES[:5], 1e20)
    made = synthetic_endurance.make()
    made.volumes[0][0].schedule += yaml.safe_dump({"plan": {"damage": planned}})
    recording = EnduranceRecording(synthetic_endurance.write(tmp_path, made))
    np.testing.assert_array_equal(damage_plan(recording), [1e20] * 5 + [np.nan])
    np.testing.assert_allclose(planned_total(recording), [80, 40] @ recording.planned_damage)
    page = write_report(recording.path, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "not known" in page
    assert "over the damage plan" in page


def test_deviations_are_the_shares_that_the_monitor_raises_alarms_at(made, recording):
    limits = [alarm for alarm in made.alarms if alarm.kind is AlarmKind.LIMIT]
    assert limits
    found = deviations(recording)
    for alarm in limits:
        row, column = synthetic_endurance.NAMES.index(alarm.channel), list(Statistic).index(alarm.measure)
        # Recorded in float32.
        assert found[alarm.repeat, row, column] == pytest.approx(alarm.size, rel=1e-4)
    assert np.isnan(found[made.unknown]).all()


def test_the_report_tells_progress_damage_alarms_and_what_was_not_kept(made, page):
    text = re.sub(r"<[^>]+>", " ", page.split("<script>")[0])
    text = html.unescape(re.sub(r"\s+", " ", text))
    assert "120 of 120 repeats were played, of which the end of 1 is not known" in text
    assert "Repeat 33 (rough) counts as played, its damage as planned: the rig left." in text
    for alarm in made.alarms:
        assert alarm.sentence in text
        assert f"{datetime(2026, 3, 1, 6, 30, tzinfo=UTC) + timedelta(minutes=alarm.repeat):%Y-%m-%d %H:%M} UTC" in text
    assert "of each event the first 2, every 20th, and 1 before and after an alarm" in text
    assert "weeks-v0003.mcap" in text


def test_the_report_draws_every_trend_and_the_samples_of_alarms(made, page):
    figures = json.loads(re.search(r'id="figures">(.*?)</script>', page, re.S).group(1))
    for row in range(6):
        for kind in (*Statistic, "residual"):
            assert figures[f"{kind}-{row}"]["data"]
    assert "damage" in figures
    assert "alarm-0" in figures
    lines = figures[f"rms-{synthetic_endurance.CHANGED}"]["layout"]["shapes"]
    at = {shape["x0"] for shape in lines if shape.get("yref") == "paper"}
    assert at == {alarm.repeat for alarm in made.alarms if alarm.channel == "left_lateral"}


def test_a_quiet_test_that_goes_on_is_reported_without_alarms(tmp_path):
    quiet = synthetic_endurance.make(changed_from=None)
    quiet.volumes[-1][-2:] = []
    path = synthetic_endurance.write(tmp_path, quiet)
    code, _, stderr = invoke("report", path, "--out", tmp_path / "report.html")
    assert code == 0, stderr
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "No alarm was raised." in page
    assert "under way" in page


def test_a_campaign_is_no_endurance_test_and_the_other_way_round(recording_path, first):
    with pytest.raises(InputError, match="is not that of an endurance test"):
        EnduranceRecording(recording_path)
    with pytest.raises(InputError, match="is that of an endurance test and holds no campaign"):
        _ = open_recording(first).specification
    assert not open_recording(recording_path).is_endurance


def test_a_test_without_a_repeat_is_refused(tmp_path):
    empty = synthetic_endurance.make()
    steps = (sequencer_pb2.EnduranceSpec, sequencer_pb2.EnduranceVolume)
    empty.volumes[:] = [[message for message in empty.volumes[0] if isinstance(message, steps)]]
    path = synthetic_endurance.write(tmp_path, empty)
    code, _, stderr = invoke("report", path, "--out", tmp_path / "report.html")
    assert code == 2
    assert "broken off too early" in stderr


def test_damage_without_a_plan_is_counted_and_not_compared(tmp_path):
    made = synthetic_endurance.make()
    for event in made.volumes[0][0].events:
        event.ClearField("planned_damage")
    path = synthetic_endurance.write(tmp_path, made)
    page = write_report(path, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "The schedule has no plan, and no target tells" in page
    assert 'data-kind="damage" data-value=""' not in page
