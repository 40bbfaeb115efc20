"""Shorter addresses: each access to memory is the one that it was, and the code is shorter."""

import re

import numpy as np
import pytest

from rig_sim.compile import compile_model, compiled_model, sin, sqrt
from rig_sim.compile.short_addresses import IS_POSSIBLE, shortened

ACCESS = re.compile(r"(-?\d*)\(%(\w+)\)")
PROLOGUE = ["derivative:", "\tpushq\t%rbx", "\tpushq\t%r12", "\tsubq\t$4000, %rsp"]
EPILOGUE = ["\taddq\t$4000, %rsp", "\tpopq\t%r12", "\tpopq\t%rbx", "\tretq", ".Lfunc_end0:"]


def function(*body):
    return "\n".join([*PROLOGUE, *body, *EPILOGUE])


def accesses(assembly):
    """Follow the code line by line, and return what is read and written: register that does not move, and distance."""
    places, found = {}, []
    for line in assembly.split("\n"):
        if re.match(r"\S", line):
            places = {}
        if not (match := ACCESS.search(line)):
            continue
        distance, register = int(match[1] or 0), match[2]
        base, start = places.get(register, (register, 0))
        if pointed := re.match(r"\s+leaq.*, %(\w+)$", line):
            places[pointed[1]] = (base, start + distance)
        else:
            found.append((line.split()[0], base, start + distance))
    return found


def many_accesses(seed, count=400, vector=""):
    rng = np.random.default_rng(seed)
    at = 16 * rng.integers(0, 250, count)
    near = np.repeat(16 * rng.integers(0, 240, count // 20), 20) + 16 * rng.integers(0, 10, count)
    lines = []
    for number in range(count):
        place = int(at[number] if number % 5 == 0 else near[number])
        base = "rdx" if number % 7 == 0 else "rsp"
        register = f"%{vector or f'xmm{number % 15}'}"
        lines.append(
            f"\tvmovapd\t{register}, {place}(%{base}) # a comment, %rdx"
            if number % 3
            else f"\tvmulpd\t{place}(%{base}), {register}, {register}"
        )
    return lines


@pytest.mark.parametrize("seed", range(5))
def test_each_access_stays_where_it_was_and_most_are_near(seed):
    given = function(*many_accesses(seed))
    made = shortened(given, "derivative")
    assert accesses(made) == accesses(given)
    far = [sum(abs(int(number or 0)) > 128 for number, _ in ACCESS.findall(text)) for text in (made, given)]
    assert far[0] < 0.5 * far[1]


def test_a_register_is_not_trusted_beyond_a_label():
    part = many_accesses(3, count=60)
    given = function(*part, ".LBB0_2:", *part)
    assert accesses(shortened(given, "derivative")) == accesses(given)


def test_registers_that_the_body_names_or_its_callers_need_are_left_alone():
    given = function("\tmovl\t$7, %r9d", *many_accesses(1), "\tvmovq\t%r9, %xmm0")
    pointed = set(re.findall(r"leaq\t.*, %(\w+)", shortened(given, "derivative")))
    assert pointed == {"rax", "r10", "r11", "rbx", "r12"}
    framed = given.replace("\tpushq\t%rbx", "\tpushq\t%rbp\n\tmovq\t%rsp, %rbp")
    pointed = set(re.findall(r"leaq\t.*, %(\w+)", shortened(framed, "derivative")))
    assert pointed == {"rax", "r10", "r11", "r12"}


def test_a_base_that_moves_is_no_base():
    given = function(
        *many_accesses(1, count=80), "\tmovq\t8(%rsp), %rdx   # 8-byte Reload", *many_accesses(1, count=80)
    )
    assert not re.search(r"leaq\t.*\(%rdx\)", shortened(given, "derivative"))


@pytest.mark.parametrize("line", ["\tmulq\t%rcx", "\txchgq\t%rdx, %rsi", "\trep;stosq"])
def test_a_function_with_an_unknown_instruction_stays_as_it_is(line):
    given = function(*many_accesses(1), line)
    assert shortened(given, "derivative") == given
    assert shortened(given, "play") == given


@pytest.mark.parametrize("line", ["\tcallq\tsin@PLT", "\tpushq\t%r9"])
def test_what_moves_the_stack_or_uses_registers_itself_ends_the_part_that_is_shortened(line):
    first, second = many_accesses(1), many_accesses(2, count=40)
    made = shortened(function(*first, line, *second), "derivative").split("\n")
    assert made[made.index(line) + 1 :][:40] == [text.partition("#")[0].rstrip() for text in second]


@pytest.mark.parametrize("vector", ["zmm3", "xmm16", "ymm29", "ymm31"])
def test_long_forms_have_short_distances_themselves(vector):
    given = function(*many_accesses(1, vector=vector))
    assert "leaq" not in shortened(given, "derivative")
    assert "leaq" in shortened(given.replace(vector, "xmm15"), "derivative")


@pytest.mark.skipif(not IS_POSSIBLE, reason="this processor has other machine code")
def test_a_model_with_much_on_its_stack_has_the_same_bytes_and_shorter_code(monkeypatch):
    count = 60

    def model(state, inputs):
        first = [sin(state[k]) * state[(7 * k + 3) % count] for k in range(count)]
        second = [sqrt(1.0 + first[(11 * k + 5) % count] ** 2) - 0.1 * first[k] for k in range(count)]
        return [inputs[0] * second[(13 * k + 1) % count] - first[k] * second[k] for k in range(count)], [sum(second)]

    def compiled():
        return compile_model(model, state_names=[f"x{k}" for k in range(count)], input_names=["u"], lanes=False)

    short = compiled()
    monkeypatch.setattr(compiled_model, "IS_POSSIBLE", False)
    plain = compiled()
    assert len(short.code) < 0.97 * len(plain.code)
    state, commands = np.random.default_rng(4).normal(size=count), np.ones((1, 21))
    played = [each.play(state, commands, sample_interval=1e-3, substeps=2) for each in (short, plain)]
    assert played[0].outputs.tobytes() == played[1].outputs.tobytes()
    assert played[0].state.tobytes() == played[1].state.tobytes()
