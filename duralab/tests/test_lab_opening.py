"""What a script says of the lab that it opens is checked before anything is started or asked."""

import pytest

import duralab
from duralab.errors import InputError


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("out", 5),
        ("listen", 7474),
        ("recordings", ["folder"]),
        ("viewer", True),
        ("rigs", 5),
        ("rigs", "front_axle"),
        ("rigs", ()),
        ("rigs", ("front_axle", 5)),
        ("real_time", "yes"),
    ],
)
def test_a_lab_of_ones_own_of_something_else(argument, value):
    with pytest.raises(InputError, match=f"^{argument} is .*; give ") as caught, duralab.start(**{argument: value}):
        pass
    assert caught.value.field == argument


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("endpoint", 5),
        ("out", 5),
        ("identity", 5),
        ("timeout_seconds", "5"),
        ("timeout_seconds", None),
        ("timeout_seconds", 0.0),
        ("timeout_seconds", float("nan")),
    ],
)
def test_a_lab_that_runs_by_something_else(argument, value):
    with pytest.raises(InputError, match=f"^{argument} is .*; ") as caught, duralab.connect(**{argument: value}):
        pass
    assert caught.value.field == argument
