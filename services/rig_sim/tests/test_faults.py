"""Injected faults: what broken sensors say, what tired hydraulics do, and that the rig says that it is broken."""

import dataclasses

import numpy as np
import pytest
from pydantic import TypeAdapter

from rig_sim import SpecimenError, load_rig, shipped_specimens
from rig_sim.playing.faults import Fault, break_specimen
from rig_sim.playing.simulated_playback import FaultySensors

TIME = np.arange(2000) / 1000.0
CHANNEL = "left_vertical"


def fault(**document):
    return TypeAdapter(Fault).validate_python(document)


def played(rig, drive, *, seed=3, block_samples=100):
    playback = rig.playback(drive, seed=seed)
    playback.block_samples = block_samples
    for _ in playback.blocks():
        pass
    return playback


def wave(size=0.01):
    drive = np.zeros((6, len(TIME)))
    drive[0] = size * np.sin(2 * np.pi * 2.0 * TIME) ** 2
    return drive


@pytest.fixture(scope="module")
def healthy(front_axle):
    return played(front_axle, wave()).response


def broken(front_axle, *faults, **options):
    return played(dataclasses.replace(front_axle, faults=faults), wave(), **options).response


def test_a_stuck_sensor_keeps_the_value_it_had(front_axle, healthy):
    response = broken(front_axle, fault(kind="stuck_sensor", channel=CHANNEL, start=0.75))
    np.testing.assert_array_equal(response[0, :751], healthy[0, :751])
    assert np.unique(response[0, 750:]).tolist() == [healthy[0, 750]]
    np.testing.assert_array_equal(response[1:], healthy[1:])


def test_a_noisy_sensor_has_white_noise_of_its_rms_and_seed(front_axle, healthy):
    noisy = fault(kind="noisy_sensor", channel="left_lateral", rms=400.0, start=0.5, seed=9)
    noise = broken(front_axle, noisy) - healthy
    assert not noise[:, :500].any()
    assert not np.delete(noise, 1, axis=0).any()
    assert noise[1, 500:].std() == pytest.approx(400.0, rel=0.1)
    assert abs(np.corrcoef(noise[1, 500:-1], noise[1, 501:])[0, 1]) < 0.1
    np.testing.assert_array_equal(broken(front_axle, noisy) - healthy, noise)
    assert not np.allclose(broken(front_axle, noisy.model_copy(update={"seed": 10})) - healthy, noise)


def test_a_drifting_gain_grows_with_time(front_axle, healthy):
    response = broken(front_axle, fault(kind="drifting_gain", channel=CHANNEL, rate=-0.2, start=1.0))
    gain = np.where(TIME > 1.0, 1.0 - 0.2 * (TIME - 1.0), 1.0)
    np.testing.assert_allclose(response[0], gain * healthy[0], rtol=1e-12)
    np.testing.assert_array_equal(response[1:], healthy[1:])


@pytest.mark.parametrize("block_samples", [1, 7, 333])
def test_faults_do_not_depend_on_the_size_of_blocks(block_samples):
    healthy = np.random.default_rng(0).standard_normal((1, 1000))
    faults = [
        fault(kind="drifting_gain", channel="a", rate=0.5, start=0.1),
        fault(kind="noisy_sensor", channel="a", rms=1.0, start=0.2),
        fault(kind="stuck_sensor", channel="a", start=0.9),
    ]

    def spoil(size):
        sensors = FaultySensors(faults, channels=["a"], sample_rate=1000.0, seed=1)
        return np.hstack([sensors.inject_faults(k, healthy[:, k : k + size]) for k in range(0, 1000, size)])

    assert spoil(block_samples).tobytes() == spoil(1000).tobytes()


@pytest.fixture(scope="module")
def tired():
    """The axle with vertical valves that open by a tenth and half of its pressure."""
    path = shipped_specimens()["front_axle"]
    return load_rig(
        path,
        faults=[
            fault(kind="valve_saturation", actuator_kind="vertical", opening=0.1),
            fault(kind="supply_sag", share=0.5),
        ],
    )


def test_a_valve_that_opens_less_moves_its_piston_no_faster_than_its_flow(front_axle, tired):
    """At full opening of a tenth the flow is q_r/10 sqrt(dp/dp_r), with at most half the supply across each land."""
    drive = wave(0.05)
    speeds = []
    for rig in (front_axle, tired):
        playback = rig.playback(drive, seed=0)
        row = rig.model.output_names.index("left_vertical.stroke") - len(rig.specimen.responses)
        stroke = np.hstack([block.monitored[row] for block in playback.blocks()])
        # Over 50 ms: the wheel on the oil's spring swings a little faster than the flow.
        speeds.append(np.abs(stroke[50:] - stroke[:-50]).max() / 0.05)
        uses = playback.uses()[0]
        assert (uses.saturated_share > 0.2) is (rig is tired)
    kind = tired.specimen.actuator_kinds["vertical"]
    supply = tired.specimen.supply
    # The strut's force of some kN helps in one direction: a load pressure of a few tens of bar on top.
    drop = 0.5 * (supply.supply_pressure - supply.return_pressure) + 0.5 * 6.0e3 / kind.cylinder.area
    flow = 0.1 * kind.valve.rated_flow * np.sqrt(drop / kind.valve.rated_drop)
    assert speeds[1] < 1.1 * flow / kind.cylinder.area < speeds[0]


def test_a_sagged_supply_is_half_of_it(front_axle, tired):
    assert tired.specimen.supply.supply_pressure == 0.5 * front_axle.specimen.supply.supply_pressure


@pytest.mark.parametrize(
    ("named", "pressures"),
    [({}, [0.7, 0.7, 0.7]), ({"supply": "right"}, [1.0, 1.0, 0.7]), ({"supply": "supply"}, [0.7, 1.0, 1.0])],
)
def test_the_supply_that_is_named_sags_and_every_one_where_none_is(front_axle, named, pressures):
    main = front_axle.specimen.supply
    several = front_axle.specimen.model_copy(update={"supplies": {"left": main, "right": main}})
    broken = break_specimen(several, [fault(kind="supply_sag", share=0.7, **named)])
    sagged = [broken.supply, broken.supplies["left"], broken.supplies["right"]]
    assert [supply.supply_pressure / main.supply_pressure for supply in sagged] == pytest.approx(pressures)
    assert f"supply{' right' if 'right' in named.values() else ''} " in broken.title


def test_a_broken_rig_says_so(front_axle, tired):
    assert "FAULTS INJECTED: valves of kind vertical open to 10 % only; supply sagged to 50 %" in tired.specimen.title
    assert tired.content_hash != front_axle.content_hash
    assert "FAULTS" not in front_axle.specimen.title


@pytest.mark.parametrize(
    ("document", "said"),
    [
        ({"kind": "stuck_sensor", "channel": "mid"}, "fault stuck_sensor of front_axle names 'mid'; there are left_"),
        ({"kind": "valve_saturation", "actuator_kind": "big", "opening": 0.5}, "names 'big'; there are vertical"),
        ({"kind": "supply_sag", "supply": "rear", "share": 0.5}, "names 'rear'; there are supply"),
    ],
)
def test_a_fault_of_what_is_not_there_is_refused(document, said):
    with pytest.raises(SpecimenError, match=said):
        load_rig(shipped_specimens()["front_axle"], faults=[fault(**document)])


def test_a_supply_that_is_not_there_does_not_sag():
    with pytest.raises(SpecimenError, match="predecessor has no supply"):
        load_rig(shipped_specimens()["predecessor"], faults=[fault(kind="supply_sag", share=0.5)])


@pytest.mark.parametrize("share", [0.0, 1.0, -1.0])
def test_a_share_is_between_nothing_and_all(share):
    with pytest.raises(ValueError, match="share"):
        fault(kind="supply_sag", share=share)


def test_a_fault_that_leaves_no_rig_is_refused_in_one_sentence(front_axle):
    with pytest.raises(SpecimenError) as caught:
        break_specimen(front_axle.specimen, [fault(kind="supply_sag", share=0.01)])
    assert str(caught.value) == (
        "front_axle cannot be with these faults: supply: supply_pressure is 280000 Pa; it must be above "
        "return_pressure, 500000 Pa."
    )
