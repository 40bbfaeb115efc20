"""Text that is YAML and text that is none: nothing is dropped, and every fault is one sentence that says where."""

import datetime

import pytest

from strict_yaml import YamlError, parse_yaml


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
    ("text", "said"),
    [
        ("a: 1\nb: 2\na: 3", "the key 'a' is given twice (line 3, column 1)"),
        ("a:\n  - {x: 1, x: 1}", "the key 'x' is given twice (line 2, column 12)"),
        ("a: 2024-02-30", "'2024-02-30' cannot be read as timestamp (day "),
        (f"a: {'9' * 5000}", f"'{'9' * 79}… cannot be read as int ("),
        (f"a: 1{':00' * 300}.5", "cannot be read as float ("),
        ("a: !!bool perhaps", "'perhaps' cannot be read as bool ('perhaps') (line 1, column 4)"),
        ("[" * 100_000, "lists and mappings stand 101 deep in one another; 100 are allowed (line 1, column 101)"),
        ("- " * 3_000 + "a", "lists and mappings stand 101 deep in one another"),
        ("a: [1", "did not find expected ',' or ']' (line "),
        ("a: 1\n--- b", "but found another document"),
        ("a: !!python/object/apply:os.system [ls]", "could not determine a constructor for the tag"),
        ("? [1]\n: 2", "found unhashable key"),
        ("a: \x01", "control characters are not allowed"),
    ],
)
def test_what_is_none_is_one_clause_with_its_place(text, said):
    with pytest.raises(YamlError) as caught:
        parse_yaml(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300
