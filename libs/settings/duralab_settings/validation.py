"""Findings of pydantic as one sentence: the place, the value, the allowed values."""

from __future__ import annotations

import dataclasses
import datetime
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, Final, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

# A file may have tens of thousands of errors: a sentence names some of them, with the start of long keys and values.
_MOST_FINDINGS: Final = 20
_MOST_COMPARED: Final = 200
_LONGEST_SHOWN: Final = 80
_DEEPEST_SHOWN: Final = 3
_UNKNOWN: Final = frozenset({"extra_forbidden", "unexpected_keyword_argument"})
_MISSING: Final = frozenset({"missing", "missing_argument", "missing_keyword_only_argument"})
_KEY: Final = "[key]"
"""Last part of the path of a wrong key in a mapping whose keys the user chooses."""

_UNION_MEMBER: Final = re.compile(
    r"none|bool|int|float|str|bytes|date|datetime|path"
    r"|(?:list|tuple|set|frozenset|dict|literal|nullable|function-\w+|lax-or-strict|json-or-python|union)\[.*"
    r"|constrained-\w+"
)
"""Part of a path by which pydantic names a type of a union, such as float or dict[str,float]."""

_TYPES: Final = {
    **dict.fromkeys(("tuple_type", "list_type", "set_type", "frozen_set_type"), "a list"),
    **dict.fromkeys(("dict_type", "mapping_type", "model_type", "dataclass_type"), "a mapping"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a valid integer"),
    **dict.fromkeys(("float_type", "float_parsing"), "a valid number"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    **dict.fromkeys(("date_type", "date_parsing", "date_from_datetime_parsing"), "a date such as 2024-01-31"),
    **dict.fromkeys(
        ("datetime_type", "datetime_parsing", "datetime_from_date_parsing"), "a time such as 2024-01-31 12:00:00"
    ),
    "path_type": "a path",
    "none_required": "empty",
}

_TYPED: Final = frozenset({*_TYPES, "string_type", "enum", "literal_error"})
"""Errors of a value of the wrong type, of which a union has one for each of its types."""

_PATTERNS: Final = {
    "^[a-z][a-z0-9_]*$": "a name of lower case letters, digits and '_' that begins with a letter",
    # The name of a channel of a station, as its files hold it.
    r"^[ -~\u00a0-\u00ff]*[!-~\u00a1-\u00ff][ -~\u00a0-\u00ff]*$": (
        "a text of printable Latin-1 characters that is not blank"
    ),
}
"""Regular expressions of names that the sentence explains; others are quoted."""


@dataclasses.dataclass(frozen=True)
class Explanation:
    """Explanation of a validation error.

    Parameters
    ----------
    sentence : str
        All findings, up to 20 of them, with the place, the value and the allowed values; ends with "." or "?".
    field : str
        Path of the first finding, e.g. "stop.iterations"; empty for the whole document.
    """

    sentence: str
    field: str


def explain_validation(
    error: ValidationError,
    model: type[Any] | None = None,
    *,
    place: Sequence[str] = (),
    hidden: Collection[str] = (),
    is_part: bool = False,
    joint: str = ": ",
    prefix: str = "",
    older: Callable[[Sequence[str]], Mapping[str, str]] | None = None,
) -> Explanation:
    """Explain a validation error in one sentence.

    Parameters
    ----------
    error : ValidationError
        Error of pydantic.
    model : type, optional
        Model of the document; without it the sentence names no allowed keys.
    place : sequence of str
        Keys of the document that lead to the part that was validated.
    hidden : collection of str
        Tags of unions, which pydantic puts into the path.
    is_part : bool
        Whether keys of the part itself may be missing.
    joint : str
        Text between the path and the message of a validator. An error with a `field` names that key of its section.
    prefix : str
        Path of the document itself; empty if it is the whole.
    older : callable, optional
        Returns the old names of a section's keys with the present ones, for the key that was probably meant.

    Returns
    -------
    Explanation
        Sentence and its first field.
    """
    findings = error.errors(include_url=False)
    if is_part:
        findings = [finding for finding in findings if finding["type"] not in _MISSING or len(finding["loc"]) > 1]
    for finding in findings:
        finding["loc"] = (*place, *(part for part in finding["loc"] if part not in hidden))
    _name_no_types(findings)
    names = _Names(model, prefix, older)
    alternatives = _by_value(_without_echoes(findings, names))
    sentence = "; ".join(_in_words(finding, names, joint) for finding in alternatives[:_MOST_FINDINGS])
    if (more := len(alternatives) - _MOST_FINDINGS) > 0:
        sentence += f"; {more} more are wrong"
    findings = alternatives[0]
    location = _without_key_mark(findings[0]["loc"])
    if key := getattr(findings[0].get("ctx", {}).get("error"), "field", None):
        location = (*location, key)
    return Explanation(f"{sentence}{'' if sentence.endswith('?') else '.'}", names.path(location))


@dataclasses.dataclass(frozen=True)
class _Names:
    """Names of the keys of a document."""

    model: type[Any] | None
    prefix: str
    older: Callable[[Sequence[str]], Mapping[str, str]] | None

    def path(self, location: Sequence[int | str]) -> str:
        """Return the dotted path of a place."""
        parts = [_cut(str(part)) for part in location]
        return ".".join([self.prefix, *parts] if self.prefix else parts)

    def meant(self, location: Sequence[int | str]) -> str | None:
        """Return the key that is most similar to an unknown one, by its present or an old name."""
        *place, key = location
        older = self.older([str(part) for part in place]) if self.older is not None else {}
        close = get_close_matches(_cut(str(key)), [*_keys_at(self.model, place), *older], n=1)
        return older.get(close[0], close[0]) if close else None

    def description(self, location: Sequence[int | str]) -> str:
        """Return the description of a key; for a value in a list or in a mapping by name, that of the whole."""
        for depth in range(len(location), 0, -1):
            if found := _keys_at(self.model, location[: depth - 1]).get(str(location[depth - 1]), ""):
                return found
        return ""


def _without_echoes(findings: list[ErrorDetails], names: _Names) -> list[ErrorDetails]:
    """Leave out findings that result from another one.

    Such findings are a missing key that an unknown one misspells, and an error of a whole with a wrong part: a list
    without its wrong entry is too short.
    """
    around = {finding["loc"][:depth] for finding in findings for depth in range(len(finding["loc"]))}
    meant = {
        (*finding["loc"][:-1], close)
        for finding in findings[:_MOST_COMPARED]
        if finding["type"] in _UNKNOWN and (close := names.meant(finding["loc"])) is not None
    }
    return [
        finding
        for finding in findings
        if finding["loc"] not in around and (finding["type"] not in _MISSING or finding["loc"] not in meant)
    ]


def _name_no_types(findings: list[ErrorDetails]) -> None:
    """Remove the types of unions from the paths."""
    # A union has an error for each of its types; a single part of such a name is a key of the user.
    parts: dict[tuple[int | str, ...], set[int | str]] = {}
    for finding in findings:
        for depth, part in enumerate(finding["loc"]):
            parts.setdefault(finding["loc"][:depth], set()).add(part)
    unions = {
        place
        for place, found in parts.items()
        if len(found) > 1 and all(isinstance(part, str) and _UNION_MEMBER.fullmatch(part) for part in found)
    }
    for finding in findings:
        location = finding["loc"]
        finding["loc"] = tuple(part for depth, part in enumerate(location) if location[:depth] not in unions)


def _by_value(findings: list[ErrorDetails]) -> list[list[ErrorDetails]]:
    """Return the findings by value: those about one value are alternatives, of which one is enough."""
    found: dict[tuple[object, ...], list[ErrorDetails]] = {}
    for number, finding in enumerate(findings):
        key = (*finding["loc"], id(finding["input"])) if finding["type"] in _TYPED else (number, None, None)
        found.setdefault(key, []).append(finding)
    return list(found.values())


def _without_key_mark(location: tuple[int | str, ...]) -> tuple[int | str, ...]:
    return location[:-1] if location[-1:] == (_KEY,) else location


def _in_words(alternatives: list[ErrorDetails], names: _Names, joint: str) -> str:
    finding = alternatives[0]
    context, location, kind = finding.get("ctx", {}), finding["loc"], finding["type"]
    is_key, location = location[-1:] == (_KEY,), _without_key_mark(location)
    path = names.path(location)
    if kind in _UNKNOWN:
        return _unknown_key(location, names)
    description = names.description(location)
    hint = f" ({description.rstrip('.')})" if description else ""
    if kind in _MISSING:
        return f"{path} is missing{hint}"
    if kind == "value_error":
        return f"{path}{joint if path else ''}{str(context['error']).rstrip('.')}"
    value = _cut(_shown(finding["input"]))
    alone = len(alternatives) == 1
    wanted = " or ".join(dict.fromkeys(_wanted(one, alone=alone) for one in alternatives))
    wanted = wanted if alone else f"it must be {wanted}"
    if is_key:
        mapping = names.path(location[:-1])
        return f"the key {value}{f' of {mapping}' if mapping else ''} is not allowed; {wanted}{hint}"
    return f"{path or 'the document'} is {value}; {wanted}{hint}"


def _wanted(finding: ErrorDetails, *, alone: bool) -> str:
    """Return what is allowed; `alone` is whether no other type is."""
    context, kind = finding.get("ctx", {}), finding["type"]
    message = finding["msg"].removeprefix("Assertion failed, ")
    match kind:
        case "enum" | "literal_error":
            wanted = f"allowed: {context['expected'].replace(' or ', ', ')}" if alone else context["expected"]
        case "string_pattern_mismatch":
            words = _PATTERNS.get(context["pattern"])
            wanted = f"it must be {words}" if words else f"it must match {context['pattern']}"
        case "string_type":
            # YAML reads yes, 12 and 2024-01-31 as something else.
            is_scalar = isinstance(finding["input"], bool | int | float | datetime.date)
            wanted = f"it must be a text{' in quotes' if is_scalar else ''}"
        case "too_long" | "too_short":
            word, count = ("most", context["max_length"]) if kind == "too_long" else ("least", context["min_length"])
            wanted = f"it must have at {word} {count} item{'' if count == 1 else 's'}"
        case _ if kind in _TYPES:
            wanted = f"it must be {_TYPES[kind]}"
        case _ if " should " in message:
            wanted = f"it must {message.split(' should ', maxsplit=1)[1]}"
        case _:
            wanted = f"{message[:1].lower()}{message[1:]}"
    return wanted if alone else wanted.removeprefix("it must be ")


def _shown(value: object, depth: int = 0) -> str:
    """Return a value as a file has it: an empty one and dates are not those of Python."""
    if value is None:
        return "null" if depth else "empty"
    if isinstance(value, datetime.datetime):
        return value.isoformat(sep=" ")
    if isinstance(value, datetime.date):
        return value.isoformat()
    if depth < _DEEPEST_SHOWN and type(value) is list:
        return f"[{', '.join(_shown(entry, depth + 1) for entry in value)}]"
    if depth < _DEEPEST_SHOWN and type(value) is dict:
        return f"{{{', '.join(f'{key!r}: {_shown(entry, depth + 1)}' for key, entry in value.items())}}}"
    return repr(value)


def _unknown_key(location: Sequence[int | str], names: _Names) -> str:
    key, allowed, parent = str(location[-1]), _keys_at(names.model, location[:-1]), names.path(location[:-1])
    place = f" in {parent}" if parent else ""
    known = f"; allowed: {', '.join(allowed)}" if allowed else ""
    close = names.meant(location)
    guess = f"; did you mean {close!r}?" if close else ""
    return f"unknown key {_cut(repr(key))}{place}{known}{guess}"


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 1]}…"


def _keys_at(model: type[Any] | None, location: Sequence[int | str]) -> dict[str, str]:
    """Return the keys of the section at a place of a document with their descriptions; empty if no section is known."""
    named_by_user = False
    for part in location:
        # An index or a name that the user gives: the section is that of the list or of the mapping.
        if named_by_user or isinstance(part, int):
            named_by_user = False
            continue
        annotation = _annotations(model).get(part)
        if annotation is None:
            return {}
        model, named_by_user = _section(annotation)
    if model is None:
        return {}
    if issubclass(model, BaseModel):
        return {field.alias or name: field.description or "" for name, field in model.model_fields.items()}
    return {field.name: "" for field in dataclasses.fields(model)}


def _annotations(model: type[Any] | None) -> dict[str, Any]:
    if model is None or not issubclass(model, BaseModel):
        return {}
    return {field.alias or name: field.annotation for name, field in model.model_fields.items()}


def _section(annotation: Any) -> tuple[type[Any] | None, bool]:
    """Return the only section in an annotation, None without one or with a choice, and whether it is in a mapping."""
    parts = [annotation]
    # The list grows while it is read: annotations are nested.
    for part in parts:
        parts += get_args(part)
    sections = {part for part in parts if isinstance(part, type) and _is_section(part)}
    return sections.pop() if len(sections) == 1 else None, any(get_origin(part) is dict for part in parts)


def _is_section(part: type[Any]) -> bool:
    return issubclass(part, BaseModel) or dataclasses.is_dataclass(part)
