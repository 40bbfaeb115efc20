"""YAML as the lab takes it: a key stands once, nothing is nested without end, and what is wrong is one sentence."""

from __future__ import annotations

from typing import Any, Final

import yaml

DEEPEST: Final = 100
"""Lists and mappings in one another. PyYAML reads them by recursion: in C, where it is built with it, an overflow of
the stack ends the process."""

_LONGEST_QUOTED: Final = 80

#: The safe loader, in C where PyYAML was built with it: 20 times faster on a specimen.
_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class YamlError(ValueError):
    """Text that is not YAML as it is taken here; the message is a clause that ends with the place."""


class _StrictLoader(_SafeLoader):
    """Refuses a key that is given twice; YAML's own readers take the last one and say nothing."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in keys:
                raise _marked(f"the key {_quoted(key.value)} is given twice", key)
            keys.add(key.value)
        return super().construct_mapping(node, deep)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, ValueError) as error:
            # Looks like a date or a number and is none, or a tag says that it is one.
            kind = node.tag.rpartition(":")[2]
            raise _marked(f"{_quoted(node.value)} cannot be read as {kind} ({error})", node) from error


def parse_yaml(text: str) -> Any:
    """Return what a YAML text holds.

    Parameters
    ----------
    text : str
        One document.

    Returns
    -------
    Any
        Mappings, lists and single values; None of an empty text.

    Raises
    ------
    YamlError
        It is no YAML, holds a key twice, a date or number that is none, or is nested deeper than `DEEPEST`.
    """
    try:
        _check_depth(text)
        return yaml.load(text, Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        raise YamlError(f"{error.problem}{place}") from error
    except yaml.YAMLError as error:
        raise YamlError(" ".join(str(error).split())) from error


def _check_depth(text: str) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=_SafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > DEEPEST:
                raise _marked(f"lists and mappings stand {depth} deep in one another; {DEEPEST} are allowed", event)
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def _marked(problem: str, place: Any) -> yaml.MarkedYAMLError:
    """Return the error of a node or an event."""
    return yaml.MarkedYAMLError(problem=problem, problem_mark=place.start_mark)


def _quoted(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST_QUOTED else f"{text[:_LONGEST_QUOTED]}…"
