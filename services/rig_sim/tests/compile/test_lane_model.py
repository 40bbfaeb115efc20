"""Variants of one structure in lanes: each plays as it does alone, whatever plays beside it."""

import re

import numpy as np
import pytest
from graph_interpreter import interpret
from llvmlite import binding as llvm

from rig_sim.compile import (
    FOLDER_VARIABLE,
    WIDTHS,
    LaneModel,
    Method,
    Run,
    compile_model,
    cos,
    fingerprint,
    inverse_sqrt,
    maximum,
    select_positive,
    sin,
    tanh,
    trace_model,
    unite,
    widest_lanes,
)
from rig_sim.compile import lane_model as lane_model_module
from rig_sim.compile.constants import LaneTable
from rig_sim.compile.lane_model import PlannedVariants
from rig_sim.compile.operations import Operation
from rig_sim.compile.tracing import creation_order
from rig_sim.compile.variants import fused

GRAVITY = 9.81
NAMES = {"state_names": ("q1", "q2", "v1", "v2"), "input_names": ("torque1", "torque2"), "output_names": ("a1", "a2")}
STEPS = {"sample_interval": 2e-3, "substeps": 2, "method": Method.VERNER_6}
#: Masses, lengths, friction; of the second some are equal, of the others none.
PARAMETERS = (
    (1.3, 0.7, 0.9, 1.4, 0.3),
    (1.1, 1.1, 0.9, 0.9, 0.3),
    (0.8, 1.9, 1.2, 0.75, 0.05),
    (2.3, 0.45, 0.6, 1.7, 0.9),
)


def pendulum(m1, m2, l1, l2, friction):
    """Return a double pendulum with friction and a stop, of which every kind of operation is a part."""

    def model(state, inputs):
        q1, q2, v1, v2 = state
        c, s = cos(q1 - q2), sin(q1 - q2)
        a, b, d = (m1 + m2) * l1**2, m2 * l1 * l2 * c, m2 * l2**2
        stop = select_positive(q2 - 0.5, 3.0 * (q2 - 0.5), 0.0)
        t1 = inputs[0] - m2 * l1 * l2 * s * v2 * v2 - (m1 + m2) * GRAVITY * l1 * sin(q1) - friction * tanh(v1 / 0.1)
        t2 = inputs[1] + m2 * l1 * l2 * s * v1 * v1 - m2 * GRAVITY * l2 * sin(q2) - stop - maximum(v2, 0.0)
        determinant = a * d - b * b
        accelerations = [(d * t1 - b * t2) / determinant, (a * t2 - b * t1) / determinant]
        return [v1, v2, *accelerations], accelerations

    return model


def traced(function):
    return trace_model(function, state_names=NAMES["state_names"], input_names=NAMES["input_names"])


def united(*functions):
    models = [traced(function) for function in functions]
    return unite(models, [fingerprint(model) for model in models])


@pytest.fixture(scope="module")
def pendulums():
    """Return the variants, those of each alone, and all of them in lanes of every width."""
    functions = [pendulum(*parameters) for parameters in PARAMETERS]
    variants = united(*functions)
    single = [compile_model(function, **NAMES) for function in functions]
    return single, {width: LaneModel(variants, runs=width, widest=width, **NAMES) for width in WIDTHS}


def run(seed, *, samples=500, size=1.0):
    random = np.random.default_rng(seed)
    return Run(0.3 * random.standard_normal(4), size * random.standard_normal((2, samples + 1)))


def bytes_of(playback):
    return playback.outputs.tobytes(), playback.state.tobytes(), playback.diverged_at, playback.diverged_states


def alone(model, which, **steps):
    return model.play(which.state, which.commands, bounds=which.bounds, **STEPS | steps)


@pytest.mark.parametrize("method", Method)
@pytest.mark.parametrize("width", WIDTHS)
def test_each_lane_plays_its_variant_as_the_single_player_does(pendulums, width, method):
    single, lanes = pendulums
    variants = [lane % 4 for lane in range(width)]
    runs = [run(seed) for seed in range(width)]
    played = lanes[width].play(variants, runs, **STEPS | {"method": method})
    for variant, which, found in zip(variants, runs, played, strict=True):
        expected = alone(single[variant], which, method=method)
        scale = np.abs(expected.outputs).max(axis=1, keepdims=True)
        np.testing.assert_allclose(found.outputs / scale, expected.outputs / scale, rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.state, expected.state, rtol=1e-10, atol=1e-10)
        assert found.diverged_at is None


def test_lanes_of_any_width_and_with_any_neighbours_give_the_same_bytes(pendulums):
    _, lanes = pendulums
    which = run(3)
    expected = bytes_of(lanes[4].play([2], [which], **STEPS)[0])
    assert bytes_of(lanes[4].play([0, 1, 3, 2], [run(7), run(8), run(9), which], **STEPS)[3]) == expected
    beside = [run(seed, samples=100 * seed) for seed in range(1, 8)]
    for place in (0, 5, 7):
        runs = [*beside[:place], which, *beside[place:]]
        variants = [3] * place + [2] + [1] * (7 - place)
        assert bytes_of(lanes[8].play(variants, runs, **STEPS)[place]) == expected


@pytest.mark.parametrize("width", WIDTHS)
def test_a_lane_that_leaves_its_bounds_ends_alone_and_as_the_single_player_says(pendulums, width):
    single, lanes = pendulums
    bounds = np.array([2.0, np.finfo(float).max, 1e6, 1e6])
    wild = Run(np.array([0.1, 0.0, 0.0, 0.0]), np.full((2, 501), 60.0), bounds)
    wilder = Run(np.full(4, np.nan), np.zeros((2, 51)))
    calm = [run(seed) for seed in range(2)]
    together = lanes[width].play([0, 1, 2, 3], [calm[0], wild, wilder, calm[1]], **STEPS)
    expected = alone(single[1], wild)
    assert 0 < together[1].diverged_at == expected.diverged_at < 500
    assert together[1].diverged_states == expected.diverged_states == ("q1",)
    assert together[1].outputs.shape == expected.outputs.shape
    np.testing.assert_allclose(together[1].outputs, expected.outputs, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(together[1].state, expected.state, rtol=1e-9)
    assert together[2].diverged_at == 0
    assert together[2].diverged_states == NAMES["state_names"]
    for lane, which in ((0, calm[0]), (3, calm[1])):
        assert bytes_of(together[lane]) == bytes_of(lanes[width].play([lane], [which], **STEPS)[0])


def test_records_of_any_length_end_each_at_its_own(pendulums):
    _, lanes = pendulums
    runs = [run(seed, samples=samples) for seed, samples in enumerate((500, 0, 17, 200))]
    together = lanes[4].play([0, 1, 2, 3], runs, **STEPS)
    for variant, (which, found) in enumerate(zip(runs, together, strict=True)):
        assert found.outputs.shape == (2, which.commands.shape[1] - 1)
        assert bytes_of(found) == bytes_of(lanes[4].play([variant], [which], **STEPS)[0])


def test_chunks_give_the_bits_of_one_call(pendulums):
    _, lanes = pendulums
    runs = [run(seed, samples=90) for seed in range(4)]
    whole = lanes[4].play([0, 1, 2, 3], runs, **STEPS)
    states, parts = [each.state for each in runs], []
    for begin in range(0, 90, 30):
        pieces = [Run(state, each.commands[:, begin : begin + 31]) for state, each in zip(states, runs, strict=True)]
        part = lanes[4].play([0, 1, 2, 3], pieces, **STEPS)
        states = [each.state for each in part]
        parts.append([each.outputs for each in part])
    for lane in range(4):
        assert np.hstack([part[lane] for part in parts]).tobytes() == whole[lane].outputs.tobytes()
        assert states[lane].tobytes() == whole[lane].state.tobytes()


def test_what_is_united_computes_what_each_variant_does():
    functions = [pendulum(*parameters) for parameters in PARAMETERS]
    variants = united(*functions)
    random = np.random.default_rng(4)
    leaves = [leaf.name for leaf in (*variants.traced.state, *variants.traced.inputs)]
    point = dict(zip(leaves, random.standard_normal(6), strict=True))
    for number, function in enumerate(functions):
        model = traced(function)
        expected = interpret((*model.derivative, *model.outputs), point)
        table = {leaf.name: value for leaf, value in zip(variants.constants, variants.values[:, number], strict=True)}
        twin = fused(variants.traced)
        assert any(node.operation is Operation.FUSED for node in creation_order(twin.derivative))
        for form in (variants.traced, twin):
            found = interpret((*form.derivative, *form.outputs), point | table)
            np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_constants_that_happen_to_be_equal_in_one_variant_stay_apart():
    variants = united(
        lambda s, u: ([0.5 * s[0], 0.5 * s[0] * s[1], 0.5 * s[2], s[3]], []),
        lambda s, u: ([0.5 * s[0], 0.7 * s[0] * s[1], 0.5 * s[2], s[3]], []),
    )
    np.testing.assert_array_equal(np.sort(variants.values.T, axis=1), [[0.5, 0.5], [0.5, 0.7]])
    # In the first variant both products with 0.5 s0 are one node.
    assert variants.traced.derivative[1].operation is Operation.MULTIPLY


def test_operands_go_together_also_where_one_variant_made_them_in_another_order():
    def model(k):
        return lambda s, u: ([k * s[1], cos(s[0]) + 0.5 * s[1], s[2], s[3]], [])

    models = [traced(model(k)) for k in (0.7, 0.5)]  # of the second, the last product is the first one
    assert [each.derivative[1].operands[0].operation for each in models] == [Operation.COS, Operation.MULTIPLY]
    variants = united(model(0.7), model(0.5))
    for number, each in enumerate(models):
        table = {leaf.name: value for leaf, value in zip(variants.constants, variants.values[:, number], strict=True)}
        point = {leaf.name: 0.3 + 0.2 * place for place, leaf in enumerate((*each.state, *each.inputs))}
        found = interpret(variants.traced.derivative, point | table)
        np.testing.assert_allclose(found, interpret(each.derivative, point), rtol=1e-15)


@pytest.mark.parametrize(
    "other",
    [
        lambda s, u: ([s[1], u[0] - 0.0 * s[0], s[3], s[2]], [s[0]]),
        lambda s, u: ([s[1], u[0] + 2.0 * s[0], s[3], s[2]], [s[0]]),
        lambda s, u: ([s[1], u[0] - 1.0 * s[0], s[3], s[2]], [s[0]]),
        lambda s, u: ([s[1], u[1] - 2.0 * s[0], s[3], s[2]], [s[0]]),
        lambda s, u: ([s[1], u[0] - 2.0 * s[0], s[3], s[2]], [s[0], s[1]]),
    ],
    ids=["a zero", "another sign", "a one", "another input", "another output"],
)
def test_another_structure_has_another_fingerprint(other):
    models = [traced(function) for function in (lambda s, u: ([s[1], u[0] - 2.0 * s[0], s[3], s[2]], [s[0]]), other)]
    prints = [fingerprint(model) for model in models]
    assert prints[0].digest != prints[1].digest
    with pytest.raises(ValueError, match="different structures"):
        unite(models, prints)


def test_all_batches_of_a_structure_are_one_entry_among_the_kept_code(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "code"))
    lane_model_module._module.cache_clear()
    for first in (0, 2):
        functions = [pendulum(*(factor * (first + 1.1) for factor in (1.0, 1.3, 1.7, 0.4, 0.2 + k))) for k in range(3)]
        LaneModel(united(*functions), runs=4, widest=4, **NAMES)
        lane_model_module._module.cache_clear()
    assert len(list((tmp_path / "code").iterdir())) == 1


def test_more_runs_than_lanes_are_refused(pendulums):
    _, lanes = pendulums
    with pytest.raises(ValueError, match=r"There are 5 runs for 4 lanes; give 1 to 4\."):
        lanes[4].play([0] * 5, [run(1)] * 5, **STEPS)


@pytest.mark.parametrize(
    ("features", "width"),
    [
        ({"avx2": True, "fma": True, "avx512f": True, "avx512dq": True}, 8),
        ({"avx2": True, "fma": True, "avx512f": False}, 4),
        ({"avx2": True, "fma": False}, 1),
        ({"neon": True}, 1),
    ],
)
def test_the_processor_says_how_wide_a_vector_is(monkeypatch, features, width):
    monkeypatch.setattr(lane_model_module.llvm, "get_host_cpu_features", lambda: features)
    widest_lanes.cache_clear()
    assert widest_lanes() == width
    monkeypatch.undo()
    widest_lanes.cache_clear()


@pytest.mark.parametrize(("width", "register"), [(4, "ymm"), (8, "zmm")])
def test_a_vector_is_one_register_where_the_processor_has_it(width, register):
    planned = PlannedVariants.of(united(pendulum(*PARAMETERS[0])))
    module = llvm.parse_assembly(planned.text(LaneTable(planned.constants, rigs=width), width=width))
    # This processor is tuned for 256 bits, as most that have 512 are.
    target = llvm.Target.from_triple("x86_64-unknown-linux-gnu").create_target_machine(cpu="skylake-avx512", opt=2)
    text = target.emit_assembly(module)
    assert set(re.findall(r"vmulpd.*%([xyz]mm)\d+$", text, flags=re.M)) == {register}
    derivative = text[text.index("\nderivative:") : text.index("\nplay_")]
    assert "call" not in derivative  # for no function of a single lane


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("divides_fast", [False, True])
def test_one_over_a_root_is_right_to_two_units_in_the_last_place(monkeypatch, width, divides_fast):
    fast = {llvm.get_host_cpu_name()} if divides_fast else set()
    monkeypatch.setattr(lane_model_module, "_FAST_DIVIDERS", frozenset(fast))
    names = {"state_names": ("x",), "input_names": ()}
    variants = unite(
        [model := trace_model(lambda state, inputs: ([inverse_sqrt(state[0])], []), **names)], [fingerprint(model)]
    )
    planned = PlannedVariants.of(variants)
    text = planned.text(LaneTable(planned.constants, rigs=width), width=width)
    found = re.findall(r"fdiv|call.*@llvm\.sqrt", text[text.index("@derivative") : text.index("\n}")])
    assert len(found) == (2 if divides_fast else 0)
    lanes = LaneModel(variants, runs=width, widest=width, output_names=(), **names)

    def at(numbers):
        runs = [Run(np.array([number]), np.zeros((0, 1))) for number in numbers]
        groups = [runs[begin : begin + width] for begin in range(0, len(runs), width)]
        return np.array([rates[0] for group in groups for rates, _ in lanes.evaluate([0] * len(group), group)])

    numbers = np.concatenate([10.0 ** np.random.default_rng(2).uniform(-300.0, 300.0, 400), 4.0 ** np.arange(-8, 8)])
    expected = 1.0 / np.sqrt(numbers)
    assert np.max(np.abs(at(numbers) - expected) / np.spacing(expected)) <= 2
    assert np.isnan(at([np.nan])).all()
    assert at([np.inf]) == 0.0 if divides_fast else not np.isfinite(at([np.inf])).any()
