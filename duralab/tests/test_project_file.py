"""Project files: what events share, what is theirs, in which order they are made."""

from types import SimpleNamespace

import numpy as np
import pytest
import synthetic_campaign
import yaml

from duralab.campaign import Judgement, is_project, load_campaign, load_project, parse_project, shipped_projects
from duralab.data import IterationTable
from duralab.errors import InputError
from duralab.lab.event_order import likeness, nearest, ordered
from duralab.lab.project_drives import blended
from duralab.lab.project_result import EventResult, ProjectResult

SHARED = {
    key: value for key, value in yaml.safe_load(load_campaign("front_axle_demo").text).items() if key != "target"
} | {"name": "tracks"}


def road(number, **more):
    return {"target": {"vehicle": "predecessor", "road": {"iso_class": "C", "seed": number, "duration": 8.0}}, **more}


def project(events, **shared):
    return parse_project(yaml.safe_dump(SHARED | shared | {"events": events}), name="own.yaml")


def test_an_event_overrides_what_is_shared_key_by_key():
    found = project(
        {"rough": road(1, stop={"iterations": 3}, priority=2), "smooth": road(2, rig="front_axle_2", repeats=40)},
        target={"speed": 12.0},
    )
    rough, smooth = found.events
    assert (rough.campaign.name, smooth.campaign.name) == ("tracks-rough", "tracks-smooth")
    assert (rough.campaign.stop.iterations, smooth.campaign.stop.iterations) == (3, SHARED["stop"]["iterations"])
    assert rough.campaign.stop.error_bound == smooth.campaign.stop.error_bound
    assert rough.campaign.target.speed == 12.0
    assert (rough.settings.priority, smooth.settings.repeats) == (2, 40)
    assert found.rigs == ("front_axle", "predecessor", "front_axle_2")


@pytest.mark.parametrize(
    ("events", "sentence"),
    [
        ({}, r"has no events"),
        ({"a": 3}, r"events\.a is 3; give a mapping"),
        ({"a": {}}, r"events\.a.*target"),
        ({"a": road(1, seed=4)}, r"events\.a has seed; all events share one identification"),
        ({"a": road(1, repeats=0)}, r"repeats"),
        ({"a": road(1, stop={"iteration": 3})}, r"iteration"),
        ({"A B": road(1)}, r"name"),
    ],
)
def test_an_event_that_cannot_be_is_refused_with_its_name(events, sentence):
    with pytest.raises(InputError, match=sentence):
        project(events)


def test_a_project_is_known_by_its_events(tmp_path):
    (tmp_path / "campaign.yaml").write_text("name: a\n")
    (tmp_path / "project.yaml").write_text("name: a\nevents: {}\n")
    assert not is_project(tmp_path / "campaign.yaml")
    assert is_project(tmp_path / "project.yaml")
    assert not is_project("front_axle_demo")
    assert all(is_project(name) for name in shipped_projects())


@pytest.mark.parametrize("name", shipped_projects())
def test_shipped_projects_are_whole(name):
    found = load_project(name)
    assert len(found.events) == 8
    assert len({event.campaign.target.model_dump_json() for event in found.events}) == 8


RATE = 200.0


def noise(seed, *, corner, samples=4000, level=1.0):
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal((2, samples)), axis=1)
    spectrum /= 1.0 + (np.fft.rfftfreq(samples, 1.0 / RATE) / corner) ** 2
    return level * np.fft.irfft(spectrum, samples, axis=1)


def test_scaled_targets_are_at_no_distance_and_explain_each_other():
    first = noise(1, corner=5.0)
    found = likeness([first, 3.0 * first, noise(2, corner=5.0)], sample_rate=RATE, band=(0.5, 40.0))
    assert found.distance[0, 1] == pytest.approx(0.0, abs=1e-6)
    assert found.explained[0, 1] == pytest.approx(1.0)
    assert found.explained[0, 2] < 0.1
    assert found.distance[0, 2] > 0.5


def test_similar_spectra_follow_each_other_whatever_the_lengths():
    low, high = (3.0, 3.2, 3.4), (25.0, 27.0)
    targets = [noise(i, corner=corner, samples=3000 + 500 * i) for i, corner in enumerate((*low, *high))]
    found = likeness(targets, sample_rate=RATE, band=(0.5, 40.0))
    order = ordered(found.distance, [0, 0, 0, 0, 0])
    kinds = [number < 3 for number in order]
    assert kinds in ([True] * 3 + [False] * 2, [False] * 2 + [True] * 3)
    # A higher priority comes first, whatever it resembles.
    assert ordered(found.distance, [0, 0, 0, 0, 1])[0] == 4
    assert nearest(found.distance, 0, [1, 3, 4], most=2)[-1] == 1


def test_drives_are_joined_without_a_jump():
    first, second = np.full((1, 100), 0.5), np.full((1, 50), -0.25)
    whole = blended([first, second], RATE)
    assert whole.shape == (1, 250)
    assert np.abs(np.diff(whole)).max() < 0.02
    np.testing.assert_array_equal(whole[:, -50:], second)
    np.testing.assert_array_equal(blended([first], RATE), first)


def test_a_project_names_the_reason_why_an_event_did_not_reach_its_target():
    events = project({"a": road(1), "b": road(2), "c": road(3)}).events
    made = synthetic_campaign.make(seconds=4.0, iterations=2)

    def result(judgement, sentence):
        table = IterationTable.from_messages([synthetic_campaign.metrics(made, row) for row in range(2)])
        verdict = SimpleNamespace(judgement=judgement, sentence=sentence)
        return SimpleNamespace(iterations=table, verdict=verdict, recording_path="x.mcap")

    missed = "The target was not reached: 27.4 % of the energy is outside the control band."
    found = ProjectResult(
        "tracks",
        (
            EventResult(events[0], result(Judgement.REACHED, "The target was reached.")),
            EventResult(events[1], result(Judgement.NOT_REACHED, missed)),
            EventResult(events[2], None, error="The rig is latched."),
        ),
    )
    assert str(found).endswith(f"\n- b: {missed}\n- c: The rig is latched.")
    assert [event["reason"] for event in found.document()["events"]] == ["", missed, "The rig is latched."]
