"""Text that is YAML and text that is none: nothing is dropped, and every fault is one sentence that says where."""

import datetime
import random

import pytest

from duralab_settings import LARGEST_TEXT, YamlError, dump_yaml, parse_yaml, read_yaml_text


def test_what_is_yaml_is_what_it_says():
    text = "a: [1, 2.5, yes, null]\nday: 2024-02-29\nbase: &base {x: 1, y: 2}\nown: {<<: *base, y: 3}\n1: one\n"
    assert parse_yaml(text) == {
        "a": [1, 2.5, True, None],
        "day": datetime.date(2024, 2, 29),
        "base": {"x": 1, "y": 2},
        "own": {"x": 1, "y": 3},
        1: "one",
    }
    assert parse_yaml("") is None
    assert parse_yaml("[" * 100 + "]" * 100)
    assert parse_yaml("[" + "[], {}, " * 100 + "]")


@pytest.mark.parametrize(
    ("text", "number"),
    # By the core schema of YAML 1.2, chapter 10.3.2.
    [
        *[("6e1", 60.0), ("25e-4", 25e-4), ("1e-1", 0.1), ("1E+3", 1000.0), ("-1.5e3", -1500.0), ("+.5e1", 5.0)],
        *[("1.", 1.0), ("010.5", 10.5), ("0.0", 0.0), ("-.inf", -float("inf")), ("1.0e+5", 1e5)],
        *[("0", 0), ("-0", 0), ("+12", 12), ("0o17", 15), ("0x1F", 31), ("10", 10)],
        # Of YAML 1.1, where the value cannot be mistaken.
        *[("1_000", 1000), ("0b11", 3)],
    ],
)
def test_a_number_is_that_of_yaml_1_2(text, number):
    value = parse_yaml(f"a: {text}")["a"]
    assert (type(value), value) == (type(number), number)


@pytest.mark.parametrize(
    "text", ["1e", "e1", "1e3x", "1.2.3", ".", "+", "0o8", "08:30", "1-2", "'010'", "'1:30'", '"1e3"']
)
def test_what_looks_like_a_number_and_is_none_is_a_text(text):
    assert parse_yaml(f"a: {text}") == {"a": text.strip("'\"")}


def test_half_a_character_is_written_as_its_number():
    assert dump_yaml({"a": "\ud800", "b": "1e3"}) == "a: \"\\uD800\"\nb: '1e3'\n"


def test_a_text_that_is_written_is_read_as_text():
    texts = [
        "1e3",
        "25e-4",
        "010",
        "08",
        "1:30",
        "0o17",
        "1_000",
        "1.5",
        "yes",
        "2024-01-01",
        "null",
        "",
        "a: b",
        "ä",
        "~",
    ]
    content = {"texts": texts, "numbers": [1e3, 1e-5, 1e300, 0.1, 10, -3], "1e3": True, "day": None}
    for flow in (False, True):
        assert repr(parse_yaml(dump_yaml(content, flow=flow))) == repr(content)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: 2\na: 3", "the key 'a' is given twice (line 3, column 1)"),
        ("a:\n  - {x: 1, x: 1}", "the key 'x' is given twice (line 2, column 12)"),
        ("a: 2024-02-30", "'2024-02-30' cannot be read as timestamp (day "),
        (f"a: {'9' * 5000}", f"'{'9' * 79}… cannot be read as int ("),
        (f"a: 1{':00' * 300}.5", "cannot be read as float ("),
        (
            "a: 010",
            "'010' cannot be read as int (an integer does not begin with 0; write 10, or put a text in quotes) (line 1",
        ),
        ("a: 1\nseed: -0120", "write -120, or put a text in quotes) (line 2, column 7)"),
        ("a: 08", "write 8, or"),
        ("a: 00", "write 0, or"),
        ("a: !!int 010", "an integer does not begin with 0"),
        ("a: [1:30]", "'1:30' cannot be read as int (numbers in base 60 are not read; write it in base 10, or put"),
        ("a: 1:30.5", "'1:30.5' cannot be read as float (numbers in base 60 are not read"),
        ("a: !!bool perhaps", "'perhaps' cannot be read as bool ('perhaps') (line 1, column 4)"),
        ("[" * 100_000, "lists and mappings stand 101 deep in one another; 100 are allowed (line 1, column 101)"),
        ("- " * 3_000 + "a", "lists and mappings stand 101 deep in one another"),
        ("a: [1", "did not find expected ',' or ']' (line "),
        ("a: 1\n--- b", "but found another document"),
        ("a: !!python/object/apply:os.system [ls]", "could not determine a constructor for the tag"),
        ("? [1]\n: 2", "found unhashable key"),
        ("a: \x01", "control characters are not allowed"),
        ("*a : 1", "found undefined alias"),
        ("k: &k x\nm: {*k : 1, x: 2}", "the key 'x' is given twice (line 2, column 13)"),
        ("a: &a [*a]", "the alias *a stands within what it is an alias of (line 1, column 8)"),
        ("a: &a {<<: *a}", "the alias *a stands within what it is an alias of (line 1, column 12)"),
        ("a: !!int [1, [2]]", "expected a scalar node, but found sequence (line 1, column 4)"),
        (f"a: 0x{'f' * 4000}", "cannot be read as int (it has more than 1000 digits) (line 1, column 4)"),
        (f"a: 1{':00' * 300_000}", "cannot be read as int (it has more than 1000 digits)"),
        ("%TAG !a! x\n" * 50_000 + "--- a", "50000 of its lines begin with %, and 10 may"),
        ("#" * (LARGEST_TEXT + 1), "it has 1048577 characters, and 1048576 are allowed"),
        ("a: [" + "1, " * 100_000 + "]", "it holds more than 100000 values"),
    ],
)
def test_what_is_none_is_one_clause_with_its_place(text, said):
    with pytest.raises(YamlError) as caught:
        parse_yaml(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def doubled(levels, *, each, last):
    """Return aliases that double, or more, with every level; `each` is the text of a level of a number of aliases."""
    lines = [f"l0: &l0 {last}"]
    lines += [f"l{level}: &l{level} {each.format(*[f'*l{level - 1}'] * 9)}" for level in range(1, levels + 1)]
    return "\n".join([*lines, f"name: *l{levels}"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (doubled(10, each="[{}, {}, {}, {}, {}, {}, {}, {}, {}]", last="[x, x, x, x, x, x, x, x, x]"), "100000 values"),
        (doubled(40, each="{{a: {}, b: {}}}", last="x"), "100000 values"),
        (doubled(40, each="{{<<: [{}, {}]}}", last="{k: v}"), "100000 values"),
        (doubled(40, each="[? {} : {}]", last="x"), "100000 values"),
        (doubled(12, each="[{}, {}]", last="x" * 1000), "more than 1048576 characters"),
        (doubled(101, each="[{}]", last="x"), "stand 101 deep"),
    ],
)
def test_aliases_count_at_every_place_where_they_stand(text, said):
    """Written out, each would take gigabytes, or overflow the stack of what reads it."""
    assert len(text) < 6000
    with pytest.raises(YamlError, match=said):
        parse_yaml(text)


def written_out(value):
    """Return the number of values of a result, aliases followed: what the bound is on."""
    if isinstance(value, dict):
        return 1 + sum(written_out(key) + written_out(entry) for key, entry in value.items())
    return 1 + sum(map(written_out, value)) if isinstance(value, list) else 1


def test_the_bound_is_on_what_the_result_holds():
    """Of two lists of n, one of them n times in the other; at the bound it is read."""
    for count, allowed in ((313, True), (316, False)):
        text = f"l0: &l0 [{', '.join(['x'] * count)}]\nl1: [{', '.join(['*l0'] * count)}]"
        if allowed:
            assert 98_000 < written_out(parse_yaml(text)) < 100_000
        else:
            with pytest.raises(YamlError, match="100000 values"):
                parse_yaml(text)


def test_a_mapping_that_is_merged_elsewhere_first_has_no_key_twice():
    """PyYAML merges c before it builds b: looked for afterwards, x would seem to be given twice."""
    text = "a: &a {x: 1, z: 0}\ndeep: {b: &b {<<: *a, x: 2}}\nc: {<<: *b}"
    merged = {"x": 2, "z": 0}
    assert parse_yaml(text) == {"a": {"x": 1, "z": 0}, "deep": {"b": merged}, "c": merged}


def test_any_text_is_read_or_refused_in_one_clause():
    rng = random.Random(5)
    pieces = [*"[]{}|>\"'#\n\t1", "&a ", "*a", "&b ", "*b", "<<: ", "x: ", "- ", ", ", "  ", "? ", ": ", "0x"]
    pieces += ["!!int ", "!!set ", "!!omap ", "!!binary ", "%TAG ! x\n", "---\n", "...\n", "2024-02-30"]
    read = 0
    for _ in range(3000):
        text = "".join(rng.choices(pieces, k=rng.randrange(1, 30)))
        try:
            repr(parse_yaml(text))
            read += 1
        except YamlError as error:
            said = str(error)
            assert "\n" not in said, text
            assert len(said) < 400, text
    assert 100 < read < 2900


def test_a_file_is_read_as_text_and_one_that_is_too_large_is_not_read(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_bytes("a: ä\r\nb: 1\rc: 2".encode())
    assert read_yaml_text(path) == path.read_text(encoding="utf-8") == "a: ä\nb: 1\nc: 2"
    path.write_bytes(b"#" * LARGEST_TEXT)
    assert parse_yaml(read_yaml_text(path)) is None
    path.write_bytes(b"#" * (LARGEST_TEXT + 1))
    with pytest.raises(OSError, match="it has 1048577 bytes, and 1048576 are allowed"):
        read_yaml_text(path)
