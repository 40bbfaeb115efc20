"""A worn specimen: its static response in closed form, a peer with changed constants, its state over many runs."""

import copy

import numpy as np
import pytest
import yaml
from wearing_quarter_car import GAIN, TYRE, quarter_car

from rig_sim import Lost, SpecimenError, WearState, load_rig, shipped_specimens
from rig_sim.multibody import bushing_wrench, move
from rig_sim.specimen import read_document

TIME = np.arange(1500) / 1000.0
FADE = 0.5 * (1.0 - np.cos(2.0 * np.pi * TIME / 1.5))


def wave(rig, share=0.3):
    frequencies = (3.0, 5.0, 7.0, 4.0, 6.0, 2.5)
    return np.array(
        [
            share * channel.maximum * FADE * np.sin(2 * np.pi * frequency * TIME)
            for channel, frequency in zip(rig.specimen.drives, frequencies, strict=False)
        ]
    )


def played(rig, drive, condition=None, seed=1):
    playback = rig.playback(drive, seed=seed, condition=condition)
    for _ in playback.blocks():
        pass
    return playback


@pytest.mark.parametrize("lost", [0.1, 0.5, 0.9])
def test_a_soft_spring_sinks_by_weight_over_what_is_left_of_its_stiffness(quarter, lost):
    condition = quarter.changed({"tyre": Lost(stiffness=lost)})
    names = quarter.model.state_names
    stroke, hop = (names.index(f"{joint} position 0") for joint in ("stroke", "wheel_hop"))
    sunk = condition.rest[stroke] - condition.rest[hop]
    assert sunk == pytest.approx(370.0 * 9.81 / (2.1e5 * (1.0 - lost)), rel=1e-6)


def test_what_is_lost_of_damping_changes_nothing_at_rest(quarter):
    condition = quarter.changed({"tyre": Lost(damping=0.5), "damper": Lost(damping=0.5)})
    np.testing.assert_allclose(condition.rest, quarter.rest, atol=1e-9)


def test_a_rig_as_new_plays_the_bytes_of_one_that_says_nothing(quarter):
    drive = wave(quarter)
    assert played(quarter, drive).response.tobytes() == played(quarter, drive, quarter.changed()).response.tobytes()


def test_a_gain_multiplies_what_is_measured_and_nothing_else(quarter):
    drive = wave(quarter)
    as_new, drifted = played(quarter, drive), played(quarter, drive, quarter.changed(gains={"vertical": 0.02}))
    np.testing.assert_allclose(drifted.response, 1.02 * as_new.response, rtol=1e-14)
    assert drifted.loads().tobytes() == as_new.loads().tobytes()


def test_a_bushing_gives_no_energy_whatever_it_has_lost(front_axle_wearing):
    tree = front_axle_wearing.model.assembly.tree
    rng = np.random.default_rng(3)
    for _ in range(20):
        state = tree.default_positions + 0.02 * rng.standard_normal(len(tree.default_positions))
        motion = move(tree, state, rng.standard_normal(tree.velocity_count))
        for bushing in tree.bushings:
            left = 1.0 - rng.uniform(0.0, 0.95)
            # Without its stiffness, which keeps what it takes: damping alone.
            wrench = bushing_wrench(bushing, motion, stiffness=0.0, damping=left)
            apart = motion.velocities[bushing.body_c] - motion.velocities[bushing.body_a]
            assert apart.power(wrench) <= 1e-12
            half = bushing_wrench(bushing, motion, stiffness=0.5, damping=0.5)
            np.testing.assert_allclose(half.linear * 2.0, bushing_wrench(bushing, motion).linear, rtol=1e-9, atol=1e-9)


LOST = {
    "left_lower_rear_bushing": Lost(stiffness=0.3, damping=0.2),
    "right_tie_rod": Lost(stiffness=0.7, damping=0.6),
    "left_strut_damper": Lost(damping=0.5),
}


def one_sided(parts, name, **changes):
    """Write a mirrored part of the YAML out, the left one with other values of its law."""
    whole = []
    for part in parts:
        if part["name"] != name:
            whole.append(part)
            continue
        left = copy.deepcopy(part) | {"mirrored": False}
        left["law"] |= changes
        right = yaml.safe_load(yaml.safe_dump(part).replace("left_", "right_")) | {"mirrored": False}
        for key in ("point_a", "point_b", "axis"):
            if key in right:
                right[key] = [right[key][0], -right[key][1], right[key][2]]
        whole += [left, right]
    return whole


@pytest.fixture(scope="module")
def peer(tmp_path_factory):
    """A front axle whose SDF and YAML have the constants that are left: nothing of the code of wear is in it."""
    folder = tmp_path_factory.mktemp("peer")
    document = read_document(shipped_specimens()["front_axle"])
    rubber = {part["name"]: part["law"] for part in document["rubber"]}
    for name in ("left_lower_rear_x", "left_lower_rear_y"):
        law = {key: 0.7 * rubber[name][key] for key in ("progression", "friction")}
        document["rubber"] = one_sided(document["rubber"], name, **law)
    damping = {key: 0.5 * document["struts"][0]["law"][key] for key in ("compression_damping", "rebound_damping")}
    document["struts"] = one_sided(document["struts"], "left_strut", **damping)
    text = shipped_specimens()["front_axle"].with_suffix(".sdf").read_text()
    head, found, rest = text.partition("<drake:bushing_frameC>left_lower_rear_eye</drake:bushing_frameC>")
    assert found
    for old, new in (
        ("60 60 60", "42 42 42"),
        ("0.4 0.4 0.4", "0.32 0.32 0.32"),
        ("400000 900000 600000", "280000 630000 420000"),
        ("400 900 600", "320 720 480"),
    ):
        rest = rest.replace(f">{old}<", f">{new}<", 1)
    text = head + found + rest
    head, found, rest = text.partition(
        "<drake:linear_spring_damper_body_B>right_knuckle</drake:linear_spring_damper_body_B>"
    )
    assert found
    rest = rest.replace(">12000000<", ">3600000<", 1).replace(">4000<", ">1600<", 1)
    (folder / "front_axle.sdf").write_text(head + found + rest)
    path = folder / "peer.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return load_rig(path)


def test_a_worn_axle_is_one_with_the_constants_that_are_left(front_axle_wearing, peer):
    condition = front_axle_wearing.changed(LOST)
    np.testing.assert_allclose(condition.rest, peer.rest, rtol=0, atol=1e-9)
    drive = wave(peer)
    drive[[1, 2, 4, 5]] *= 0.2
    worn, expected = played(front_axle_wearing, drive, condition).response, played(peer, drive).response
    as_new = played(front_axle_wearing, drive).response
    scale = np.abs(expected).max(axis=1)
    assert np.abs(worn - expected).max(axis=1) / scale == pytest.approx(0.0, abs=1e-7)
    # What was lost is seen, or the comparison says nothing.
    assert (np.abs(worn - as_new).max(axis=1) / scale > 1e-3).all()


def life(rig, state, drive, runs):
    """Play one drive again and again; return the responses and the states after each."""
    responses, states = [], []
    for _ in range(runs):
        playback = played(rig, drive, rig.condition(state), seed=state.runs)
        state = rig.worn(state, playback)
        responses.append(playback.response)
        states.append(state)
    return responses, states


def test_a_crack_comes_in_the_run_in_which_the_miner_sum_passes_its_damage(quarter, tmp_path):
    drive = wave(quarter)
    once = quarter.worn(WearState(), played(quarter, drive)).damage["tyre"]
    crack = TYRE | {"kind": "crack", "at_damage": 2.5 * once}
    rig = load_rig(quarter_car(tmp_path, crack))
    responses, states = life(rig, WearState(), drive, 5)
    assert [state.damage["tyre"] for state in states[:3]] == pytest.approx([once, 2 * once, 3 * once])
    same = [response.tobytes() == responses[0].tobytes() for response in responses]
    # The third run passes it and is played to its end as it began; the fourth is of the cracked part.
    assert same == [True, True, True, False, False]
    assert responses[3].tobytes() == responses[4].tobytes()


def test_wear_is_the_same_bytes_again_and_grows_from_run_to_run(quarter):
    drive = wave(quarter)
    first, second = life(quarter, WearState(), drive, 6), life(quarter, WearState(), drive, 6)
    assert [r.tobytes() for r in first[0]] == [r.tobytes() for r in second[0]]
    assert first[1] == second[1]
    damage = np.array([state.damage["tyre"] for state in first[1]])
    assert (np.diff(damage) > 0.0).all()


def test_a_part_that_does_not_wear_cannot_have_lost(quarter):
    with pytest.raises(SpecimenError, match="'wheel' is no part that wears; there are tyre, damper"):
        quarter.changed({"wheel": Lost(stiffness=0.1)})
    with pytest.raises(SpecimenError, match="'damper' is a strut, which loses damping only"):
        quarter.changed({"damper": Lost(stiffness=0.1)})
    with pytest.raises(SpecimenError, match="'lateral' is no response; there are vertical"):
        quarter.changed(gains={"lateral": 0.1})


def test_another_specimen_of_a_kind_has_another_hash_and_a_worn_one_keeps_its_own(tmp_path):
    path = quarter_car(tmp_path, TYRE, GAIN)
    rigs = [load_rig(path), load_rig(path, mounted="specimen_1"), load_rig(path, mounted="specimen_2")]
    hashes = [rig.content_hash for rig in rigs]
    assert hashes[0] == hashes[1] != hashes[2]
    without = quarter_car(tmp_path)
    assert load_rig(without, mounted="specimen_2").content_hash == load_rig(without).content_hash


def test_a_specimen_that_cannot_stand_at_the_end_of_its_life_is_refused_at_once(tmp_path):
    # 3600 N on 5 % of the tyre: 35 cm, more than Newton's method can mend, or than the strut's stops bear.
    document = yaml.safe_load((quarter_car(tmp_path, TYRE | {"stiffness_lost": 0.95})).read_text())
    assert document["wear"][0]["stiffness_lost"] == 0.95
    rig = load_rig(tmp_path / "quarter_car.yaml")
    assert rig.changed({"tyre": Lost(stiffness=0.95)}).rest is not None


def test_the_shipped_rig_is_the_front_axle_with_wear(front_axle_wearing):
    whole = read_document(shipped_specimens()["front_axle"])
    more = read_document(shipped_specimens()["front_axle_wearing"])
    wear = more.pop("wear")
    assert more | {"name": "", "title": ""} == whole | {"name": "", "title": ""}
    assert {part["kind"] for part in wear} == {"softening", "crack", "gain_drift"}
    assert front_axle_wearing.compiled.lanes == 2
