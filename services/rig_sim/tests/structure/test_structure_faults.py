"""A structure is watched as other rigs are, and its sensors break as theirs do; it has no hydraulics to break."""

import dataclasses

import numpy as np
import pytest
from pydantic import TypeAdapter

from duralab_gateway.motion import WatchdogMonitor
from rig_sim import SpecimenError, load_any_rig, shipped_specimens
from rig_sim.playing.faults import Fault
from rig_sim.specimen.specimen import Specimen, read_specimen

PATH = shipped_specimens()["aerospace"]


def fault(**document):
    return TypeAdapter(Fault).validate_python(document)


@pytest.fixture(scope="module")
def aerospace():
    return load_any_rig(PATH)


def drive(size=1.0, samples=1500):
    given = np.zeros((4, samples))
    # The wing's torsion, where 1 N moves its tips at 260 m/s^2 once it has swung up.
    given[0] = size * np.sin(2 * np.pi * 31.07 * np.arange(samples) / 512.0)
    return given


def played(rig, given):
    playback = rig.playback(given, seed=3)
    blocks = list(playback.blocks())
    return playback.response, blocks


def tripped(rig, given):
    monitor = WatchdogMonitor(rig.watchdogs, sample_rate=512.0)
    return [monitor.first_trip(block) for block in played(rig, given)[1]]


def test_a_wing_that_swings_too_far_trips_and_a_usual_test_does_not(aerospace):
    assert not any(tripped(aerospace, drive(0.5)))
    trip = next(filter(None, tripped(aerospace, drive(20.0))))
    assert trip.watchdog.name in {"left_wing", "right_wing", "left_wing_front"}
    assert trip.sentence.endswith("s, its watchdog allows -180 to 180 m/s^2")


def test_its_sensors_stick_hiss_and_drift(aerospace):
    healthy = played(aerospace, drive())[0]
    faults = (
        fault(kind="stuck_sensor", channel="nose", start=1.0),
        fault(kind="noisy_sensor", channel="tail", rms=2.0, start=0.5),
        fault(kind="drifting_gain", channel="fin", rate=0.1),
    )
    broken = played(dataclasses.replace(aerospace, faults=faults), drive())[0]
    assert np.unique(broken[2, 512:]).tolist() == [healthy[2, 512]]
    assert (broken - healthy)[3, 256:].std() == pytest.approx(2.0, rel=0.1)
    np.testing.assert_allclose(broken[5], healthy[5] * (1.0 + 0.1 * np.arange(1500) / 512.0), rtol=1e-12)
    np.testing.assert_array_equal(np.delete(broken, [2, 3, 5], axis=0), np.delete(healthy, [2, 3, 5], axis=0))


def test_broken_it_says_so(aerospace):
    broken = load_any_rig(PATH, faults={"aerospace": [fault(kind="stuck_sensor", channel="nose")]})
    assert broken.specimen.title.endswith(" [FAULTS INJECTED: sensor nose stuck from 0 s]")
    assert broken.content_hash != aerospace.content_hash


@pytest.mark.parametrize(
    ("document", "said"),
    [
        ({"kind": "supply_sag", "share": 0.5}, "aerospace has no hydraulics; remove its fault supply_sag."),
        (
            {"kind": "valve_saturation", "actuator_kind": "vertical", "opening": 0.5},
            "aerospace has no hydraulics; remove its fault valve_saturation.",
        ),
        (
            {"kind": "stuck_sensor", "channel": "mid"},
            "fault stuck_sensor of aerospace names 'mid'; there are left_",
        ),
    ],
)
def test_a_fault_of_what_it_has_not_is_refused(document, said):
    with pytest.raises(SpecimenError) as caught:
        load_any_rig(PATH, faults={"aerospace": [fault(**document)]})
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize("limits", ["following_errors: {nose: 1.0}", "monitored: {oil: {maximum: 1.0}}"])
def test_a_watchdog_on_what_it_has_not_is_refused(tmp_path, limits):
    text = PATH.read_text()
    path = tmp_path / "mine.yaml"
    path.write_text(text.replace("watchdogs:\n", f"watchdogs:\n  {limits}\n", 1))
    with pytest.raises(SpecimenError, match=r"; there are none\."):
        load_any_rig(path)


def test_every_shipped_rig_watches_every_response(aerospace):
    for name, path in shipped_specimens().items():
        specimen = aerospace.specimen if name == "aerospace" else read_specimen(path, Specimen)
        limits = specimen.watchdogs.responses
        assert set(limits) == {channel.name for channel in specimen.responses}, name
        assert all(limits[channel.name] < channel.range for channel in specimen.responses), name
        if name != "aerospace":
            assert ("supply.pressure" in specimen.watchdogs.monitored) == bool(specimen.actuators), name
            assert bool(specimen.watchdogs.following_errors) == bool(specimen.actuators), name
