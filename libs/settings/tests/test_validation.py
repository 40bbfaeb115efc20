"""Findings of pydantic in one sentence: place, value, what is allowed, and what follows from another finding."""

import datetime
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, TypeAdapter, ValidationError, field_validator
from pydantic.dataclasses import dataclass as checked_dataclass

from duralab_settings import explain_validation


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


class Wheel(BaseModel):
    model_config = ConfigDict(extra="forbid")
    radius: float = Field(gt=0, description="Radius in m.")
    name: str = Field(default="wheel", pattern="^[a-z]+$")


@checked_dataclass(config=ConfigDict(extra="forbid"), frozen=True)
class Law:
    stiffness: Annotated[float, Field(gt=0)]


class Car(BaseModel):
    model_config = ConfigDict(extra="forbid")
    wheels: list[Wheel] = Field(min_length=1)
    spare: dict[str, Wheel] | None = None
    law: Law | None = None
    colour: Colour = Colour.RED
    drive: Literal["front", "rear"] = "front"
    load: Annotated[
        Annotated[float, Tag("one number")] | Annotated[dict[str, float], Tag("per axle")],
        Discriminator(lambda value: "per axle" if isinstance(value, dict) else "one number"),
    ] = 1.0

    @field_validator("colour")
    @classmethod
    def _not_blue_on_sundays(cls, value: Colour) -> Colour:
        if value is Colour.BLUE:
            raise ValueError("must not be blue")
        return value


ROUND = {"wheels": [{"radius": 1.0}]}


def explained(content, **options):
    with pytest.raises(ValidationError) as caught:
        Car.model_validate(content)
    return explain_validation(caught.value, Car, **{"hidden": {"one number", "per axle"}, **options})


@pytest.mark.parametrize(
    ("content", "sentence", "field"),
    [
        ({"wheels": [{}]}, "wheels.0.radius is missing (Radius in m).", "wheels.0.radius"),
        ({"wheels": [{"radius": -1}]}, "wheels.0.radius is -1; it must be greater than 0 (Radius in m).", None),
        ({"wheels": [{"radius": 1, "name": "A"}]}, "wheels.0.name is 'A'; it must match ^[a-z]+$.", None),
        (
            ROUND | {"spare": {"left": {"radius": 1, "nmae": "a"}}},
            "unknown key 'nmae' in spare.left; allowed: radius, name; did you mean 'name'?",
            "spare.left.nmae",
        ),
        # The unknown key is the missing one, misspelt.
        (
            {"wheels": [{"radus": 1}]},
            "unknown key 'radus' in wheels.0; allowed: radius, name; did you mean 'radius'?",
            None,
        ),
        (ROUND | {"law": {"stiffness": 1, "color": 2}}, "unknown key 'color' in law; allowed: stiffness.", None),
        (ROUND | {"law": 3}, "law is 3; it must be a mapping.", None),
        (ROUND | {"colour": "green"}, "colour is 'green'; allowed: 'red', 'blue'.", None),
        (ROUND | {"colour": "blue"}, "colour: must not be blue.", None),
        (ROUND | {"drive": "all"}, "drive is 'all'; allowed: 'front', 'rear'.", None),
        (ROUND | {"load": {"rear": "x"}}, "load.rear is 'x'; it must be a valid number", "load.rear"),
        ({"wheels": [], "colour": "green"}, "wheels is []; it must have at least 1 item", "wheels"),
        (None, "the document is empty; it must be a mapping", ""),
    ],
)
def test_a_finding_is_place_value_and_what_is_allowed(content, sentence, field):
    explanation = explained(content)
    assert explanation.sentence.startswith(sentence)
    assert field is None or explanation.field == field


Name = Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")]


class Plain(BaseModel):
    """Kinds of values whose errors pydantic words for programmers of Python."""

    span: tuple[float, float] = (0.0, 1.0)
    names: frozenset[str] = frozenset()
    title: str = ""
    share: float | dict[str, float] = 1.0
    frequency: dict[Name, float] = {}
    weight: dict[str, float] = {}
    level: float | Literal["auto"] = "auto"
    is_fast: bool = False
    day: datetime.date | None = None


@pytest.mark.parametrize(
    ("content", "sentence", "field"),
    [
        ({"span": 3}, "span is 3; it must be a list.", "span"),
        ({"span": [1, 2, 3]}, "span is [1, 2, 3]; it must have at most 2 items.", "span"),
        ({"names": "x"}, "names is 'x'; it must be a list.", None),
        ({"span": [None, 1]}, "span.0 is empty; it must be a valid number.", "span.0"),
        ({"title": None}, "title is empty; it must be a text.", None),
        ({"title": True}, "title is True; it must be a text in quotes.", None),
        ({"title": datetime.date(2024, 1, 1)}, "title is 2024-01-01; it must be a text in quotes.", None),
        ({"title": [None, datetime.date(2024, 1, 1)]}, "title is [null, 2024-01-01]; it must be a text.", None),
        ({"share": "x"}, "share is 'x'; it must be a valid number or a mapping.", "share"),
        ({"share": {"Fz": "x"}}, "share.Fz is 'x'; it must be a valid number.", "share.Fz"),
        ({"level": "x"}, "level is 'x'; it must be a valid number or 'auto'.", "level"),
        ({"weight": {"float": "x"}}, "weight.float is 'x'; it must be a valid number.", "weight.float"),
        (
            {"weight": {"a": "x", "b": "x"}},
            "weight.a is 'x'; it must be a valid number; weight.b is 'x'; it must",
            None,
        ),
        (
            {"frequency": {"F z": 1}},
            "the key 'F z' of frequency is not allowed; it must be a name of lower case letters, digits and '_' that "
            "begins with a letter.",
            "frequency.F z",
        ),
        ({"is_fast": "maybe"}, "is_fast is 'maybe'; it must be true or false.", None),
        ({"day": "today"}, "day is 'today'; it must be a date such as 2024-01-31.", None),
    ],
)
def test_a_sentence_has_no_words_of_python(content, sentence, field):
    with pytest.raises(ValidationError) as caught:
        Plain.model_validate(content)
    explanation = explain_validation(caught.value, Plain)
    assert explanation.sentence.startswith(sentence)
    assert field is None or explanation.field == field


def test_all_findings_are_named_at_once_up_to_twenty():
    explanation = explained({"wheels": [{"radius": -number} for number in range(1, 31)]})
    assert "wheels.19.radius is -20;" in explanation.sentence
    assert explanation.sentence.endswith("; 10 more are wrong.")


def test_long_keys_and_values_are_cut():
    sentence = explained(ROUND | {"k" * 10_000: 1, "colour": "v" * 10_000}).sentence
    assert len(sentence) < 600


def test_a_part_is_named_by_its_place_and_may_lack_keys():
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(Wheel).validate_python({"name": "A"})
    explanation = explain_validation(caught.value, Car, place=("spare", "left"), is_part=True, joint=" ")
    assert explanation.sentence == "spare.left.name is 'A'; it must match ^[a-z]+$."


def test_an_argument_of_a_function_needs_no_model():
    @dataclass
    class Anything:
        value: int

    with pytest.raises(ValidationError) as caught:
        TypeAdapter(Anything).validate_python({"value": "x"})
    assert explain_validation(caught.value).sentence.startswith("value is 'x'; it must be a valid integer")
