"""Rigs of two sides in lanes: both sides of several rigs in one vector give what each rig gives alone."""

import re

import numpy as np
import pytest
from two_sided_models import CHAIN_STATES, INPUTS, OPERATIONS, STATES, chain, looking_across, two_sides

from rig_sim.compile import WIDTHS, LaneModel, Method, Run, compile_model, fingerprint, trace_model, unite
from rig_sim.compile.constants import LaneTable
from rig_sim.compile.lane_model import PlannedVariants

STEPS = {"sample_interval": 1e-3, "substeps": 2, "method": Method.VERNER_6}


def united(models, states):
    traced = [trace_model(model, state_names=states, input_names=INPUTS) for model in models]
    return unite(traced, [fingerprint(each) for each in traced])


def in_lanes(models, states=STATES, outputs=2):
    """Return the models of one structure in lanes, by the doubles in a vector."""
    variants = united(models, states)
    names = {
        "state_names": tuple(states),
        "input_names": tuple(INPUTS),
        "output_names": tuple(f"output_{number}" for number in range(outputs)),
    }
    return {width: LaneModel(variants, runs=width, widest=width, **names) for width in WIDTHS}


def chains(*couplings):
    def one(coupling):
        return lambda state, inputs: chain(state, inputs, coupling=coupling)

    return [one(coupling) for coupling in couplings]


@pytest.mark.parametrize(
    "constants",
    [
        [(0.7, -0.7), (0.9, -1.3), (0.4, -0.4), (1.7, -0.2)],
        [(0.7, 1.3), (1.1, 1.1), (0.2, 0.6), (0.7, 0.7)],
    ],
    ids=["of opposite signs", "of one sign"],
)
@pytest.mark.parametrize("name", sorted(OPERATIONS))
def test_an_operation_on_both_sides_of_several_rigs_gives_what_numpy_gives(name, constants):
    models = [two_sides(OPERATIONS[name], each) for each in constants]
    rng = np.random.default_rng(4)
    runs = [Run(rng.uniform(-3.0, 3.0, 4), rng.normal(size=(2, 1))) for _ in models]
    found = {}
    for width, lanes in in_lanes(models).items():
        assert lanes.rigs == width // 2
        found[width] = []
        for first in range(0, 4, lanes.rigs):
            at = range(first, first + lanes.rigs)
            found[width] += lanes.evaluate(at, [runs[run] for run in at])
        for model, run, (rates, outputs) in zip(models, runs, found[width], strict=True):
            plain = [np.array(values, dtype=float) for values in model(run.state, run.commands[:, 0])]
            for ours, values in zip((rates, outputs), plain, strict=True):
                np.testing.assert_allclose(ours, values, rtol=1e-13, atol=1e-13 * np.abs(values).max())
    for first, *others in zip(*found.values(), strict=True):
        for other in others:
            assert [each.tobytes() for each in first] == [each.tobytes() for each in other]


def test_a_look_across_takes_the_other_side_of_the_same_rig():
    lanes = in_lanes([looking_across], outputs=3)
    rng = np.random.default_rng(7)
    runs = [Run(rng.normal(size=4), rng.normal(size=(2, 1))) for _ in range(4)]
    for width in WIDTHS:
        count = lanes[width].rigs
        for run, (rates, outputs) in zip(runs, lanes[width].evaluate([0] * count, runs[:count]), strict=False):
            expected = looking_across(run.state, run.commands[:, 0])
            np.testing.assert_allclose(rates, np.array(expected[0], dtype=float), rtol=1e-12)
            np.testing.assert_allclose(outputs, np.array(expected[1], dtype=float), rtol=1e-12)


def test_names_that_do_not_match_the_arrays_are_refused():
    with pytest.raises(ValueError, match=r"\(4, 2, 3\) states, inputs and outputs for \(4, 2, 2\) names"):
        in_lanes([looking_across])


@pytest.fixture(scope="module")
def racks():
    """Return variants of a chain with a rack, an odd one out among the states, alone and in lanes."""
    models = chains(0.8, 1.1, 1.3, 0.5)
    single = [compile_model(model, state_names=CHAIN_STATES, input_names=INPUTS) for model in models]
    return single, in_lanes(models, CHAIN_STATES, outputs=6)


def run(seed, *, samples=400):
    rng = np.random.default_rng(seed)
    return Run(0.3 * rng.standard_normal(10), rng.standard_normal((2, samples + 1)))


@pytest.mark.parametrize("method", Method)
@pytest.mark.parametrize("width", WIDTHS)
def test_each_rig_plays_as_it_does_alone(racks, width, method):
    single, lanes = racks
    runs = [run(seed) for seed in range(lanes[width].rigs)]
    variants = [3, 1, 0, 2][: len(runs)]
    played = lanes[width].play(variants, runs, **STEPS | {"method": method})
    for variant, which, found in zip(variants, runs, played, strict=True):
        expected = single[variant].play(which.state, which.commands, **STEPS | {"method": method})
        np.testing.assert_allclose(found.outputs, expected.outputs, rtol=1e-10, atol=1e-11)
        np.testing.assert_allclose(found.state, expected.state, rtol=1e-10, atol=1e-11)


def test_vectors_of_any_width_and_any_neighbours_give_the_same_bytes(racks):
    _, lanes = racks
    which = run(3)
    expected = lanes[4].play([2], [which], **STEPS)[0]
    for beside, place in (([], 0), ([run(4)], 1), ([run(5), run(6, samples=30), run(7)], 2)):
        runs = [*beside[:place], which, *beside[place:]]
        variants = [0] * place + [2] + [1] * (len(beside) - place)
        for model in lanes.values():
            if len(runs) <= model.rigs:
                found = model.play(variants, runs, **STEPS)[place]
                assert found.outputs.tobytes() == expected.outputs.tobytes()
                assert found.state.tobytes() == expected.state.tobytes()


def test_a_rig_out_of_bounds_names_its_own_states_and_stops_no_other(racks):
    single, lanes = racks
    bounds = np.full(10, 1e9)
    bounds[CHAIN_STATES.index("right vx")] = 0.2
    runs = [run(0), Run(run(1).state, run(1).commands, bounds)]
    calm, ended = lanes[4].play([0, 1], runs, **STEPS)
    expected = single[1].play(runs[1].state, runs[1].commands, bounds=bounds, **STEPS)
    assert ended.diverged_at == expected.diverged_at
    assert ended.diverged_states == ("right vx",)
    assert calm.outputs.tobytes() == lanes[4].play([0], runs[:1], **STEPS)[0].outputs.tobytes()


def test_how_rigs_are_computed_depends_on_no_value():
    forms = []
    for couplings in ((0.8, 1.1, 1.3), (2.5, 0.1, 0.7)):
        mirrored = PlannedVariants.of(united(chains(*couplings), CHAIN_STATES)).mirrored
        forms.append(list(mirrored.function.plan.vectors))
    assert forms[0] == forms[1]


def test_a_product_that_only_a_sum_uses_is_fused_with_it():
    planned = PlannedVariants.of(united([two_sides(OPERATIONS["add"], (0.7, 0.9))], STATES))
    text = planned.text(LaneTable(planned.constants, rigs=2), width=4)
    derivative = text[text.index("@derivative") : text.index("\n}")]
    assert "@llvm.fma.v4f64" in derivative
    for product in re.findall(r"(%x\d+) = fmul ", derivative):
        users = [line for line in derivative.splitlines() if re.search(rf"{product}\b(?! =)", line)]
        assert len(users) > 1 or not re.search("= f(add|sub) ", users[0])
