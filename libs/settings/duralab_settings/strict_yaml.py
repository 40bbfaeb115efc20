"""YAML as the lab takes it: a key stands once, nothing grows without bound, and what is wrong is one sentence."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml

from duralab_settings.regular_files import read_regular

LARGEST_TEXT: Final = 2**20
"""Bytes of a file, and characters of a text. The largest shipped file has 8 thousand."""

DEEPEST: Final = 100
"""Lists and mappings in one another, aliases followed. PyYAML reads them by recursion: in C, where it is built with it,
an overflow of the stack ends the process."""

MOST_VALUES: Final = 100_000
"""Lists, mappings, keys and single values, those of an alias counted at every place where it stands."""

MOST_DIGITS: Final = 1000
"""Characters of an integer: Python writes none of more than 4300 digits, and one in base 60 takes time in square."""

MOST_DIRECTIVES: Final = 10
"""Lines that begin with %: the parser compares each tag directive with all before it."""

_LONGEST_QUOTED: Final = 80
_DIRECTIVE: Final = re.compile("(?:^|[\n\r\x85\u2028\u2029])%")
_INTEGER_TAG: Final = "tag:yaml.org,2002:int"

#: The safe loader, in C where PyYAML was built with it: 20 times faster on a specimen.
_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class YamlError(ValueError):
    """Text that is not YAML as it is taken here; the message is a clause that ends with the place."""


class _StrictLoader(_SafeLoader):
    """Names the place of a date or number that cannot be read; `_check_extent` has refused what may not be built."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if isinstance(node, yaml.ScalarNode) and node.tag == _INTEGER_TAG and len(node.value) > MOST_DIGITS:
            raise _marked(f"{_quoted(node.value)} cannot be read as int (it has more than {MOST_DIGITS} digits)", node)
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, ValueError) as error:
            # Looks like a date or a number and is none, or a tag says that it is one.
            kind = node.tag.rpartition(":")[2]
            raise _marked(f"{_quoted(node.value)} cannot be read as {kind} ({error})", node) from error


def read_yaml_text(path: Path) -> str:
    """Return the text of a YAML file.

    Parameters
    ----------
    path : Path
        A regular file of `LARGEST_TEXT` bytes at most.

    Returns
    -------
    str
        Its lines end with a line feed only.

    Raises
    ------
    OSError
        It cannot be read, is not a regular file or is larger; `strerror` names the reason.
    UnicodeDecodeError
        It is not UTF-8.
    """
    # As a file that is opened as text: every end of a line becomes "\n".
    return read_regular(path, largest=LARGEST_TEXT).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")


def parse_yaml(text: str) -> Any:
    """Return what a YAML text holds.

    Parameters
    ----------
    text : str
        One document, of `LARGEST_TEXT` characters at most.

    Returns
    -------
    Any
        Mappings, lists and single values; None of an empty text. An alias is the same object at every place.

    Raises
    ------
    YamlError
        It is not YAML, is too large, holds a key twice, an invalid date or number, is nested deeper than `DEEPEST`,
        or holds more than `MOST_VALUES` values or `LARGEST_TEXT` characters when its aliases are written out.
    """
    if len(text) > LARGEST_TEXT:
        raise YamlError(f"it has {len(text)} characters, and {LARGEST_TEXT} are allowed")
    if (directives := len(_DIRECTIVE.findall(text))) > MOST_DIRECTIVES:
        raise YamlError(f"{directives} of its lines begin with %, and {MOST_DIRECTIVES} may")
    try:
        _check_extent(text)
        return yaml.load(text, Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        raise YamlError(f"{error.problem}{place}") from error
    except yaml.YAMLError as error:
        raise YamlError(" ".join(str(error).split())) from error


@dataclass
class _Extent:
    """What a value comes to when its aliases are written out."""

    values: int = 1
    characters: int = 0
    depth: int = 0
    scalar: str | None = None


@dataclass
class _Collection:
    """A list or mapping whose end has not been read."""

    is_mapping: bool = False
    anchor: str | None = None
    extent: _Extent = field(default_factory=lambda: _Extent(depth=1))
    parts: int = 0
    keys: set[str] = field(default_factory=set)

    def add(self, part: _Extent, event: Any, *, above: int) -> None:
        """Take in a value or key; `above` is the number of collections that the collection stands in."""
        if self.is_mapping and self.parts % 2 == 0 and part.scalar is not None:
            # YAML's own readers take the last of two equal keys and say nothing.
            if part.scalar in self.keys:
                raise _marked(f"the key {_quoted(part.scalar)} is given twice", event)
            self.keys.add(part.scalar)
        self.parts += 1
        extent = self.extent
        extent.values += part.values
        extent.characters += part.characters
        extent.depth = max(extent.depth, part.depth + 1)
        _check_depth(above + extent.depth, event)
        if extent.values > MOST_VALUES:
            raise _marked(f"it holds more than {MOST_VALUES} values, {_COUNTED}", event)
        if extent.characters > LARGEST_TEXT:
            raise _marked(f"its values have more than {LARGEST_TEXT} characters, {_COUNTED}", event)


_COUNTED: Final = "those of an alias counted at every place where it stands"


def _check_extent(text: str) -> None:
    """Refuse what would be too large or too deep once it is built, and keys that are given twice."""
    # Of each anchor; None while its end has not been read.
    anchors: dict[str, _Extent | None] = {}
    # The first is the stream of documents.
    open_collections = [_Collection()]
    for event in yaml.parse(text, Loader=_SafeLoader):
        match event:
            case yaml.CollectionStartEvent():
                _check_depth(len(open_collections), event)
                open_collections.append(_Collection(isinstance(event, yaml.MappingStartEvent), event.anchor))
                if event.anchor is not None:
                    anchors[event.anchor] = None
                continue
            case yaml.CollectionEndEvent():
                ended = open_collections.pop()
                anchor, extent = ended.anchor, ended.extent
            case yaml.ScalarEvent():
                anchor, extent = event.anchor, _Extent(characters=len(event.value), scalar=event.value)
            case yaml.AliasEvent():
                anchor, extent = None, _aliased(anchors, event)
            case _:
                continue
        if anchor is not None:
            anchors[anchor] = extent
        open_collections[-1].add(extent, event, above=len(open_collections) - 2)


def _aliased(anchors: dict[str, _Extent | None], event: yaml.AliasEvent) -> _Extent:
    # One that was not defined is refused when the text is loaded.
    extent = anchors.get(event.anchor or "", _Extent())
    if extent is None:
        raise _marked(f"the alias *{event.anchor} stands within what it is an alias of", event)
    return extent


def _check_depth(depth: int, event: Any) -> None:
    if depth > DEEPEST:
        raise _marked(f"lists and mappings stand {depth} deep in one another; {DEEPEST} are allowed", event)


def _marked(problem: str, place: Any) -> yaml.MarkedYAMLError:
    """Return the error of a node or an event."""
    return yaml.MarkedYAMLError(problem=problem, problem_mark=place.start_mark)


def _quoted(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST_QUOTED else f"{text[:_LONGEST_QUOTED]}…"
