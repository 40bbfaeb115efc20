"""YAML as accepted in the lab: a key occurs once, sizes are bounded, and an error is one sentence."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml

from duralab_settings.regular_files import read_regular

LARGEST_TEXT: Final = 2**20
"""Largest size of a file in bytes, and of a text in characters. The largest shipped file has 8 thousand."""

DEEPEST: Final = 100
"""Largest depth of nested lists and mappings, aliases followed. PyYAML reads them by recursion: in its C version, a
stack overflow ends the process."""

MOST_VALUES: Final = 100_000
"""Largest number of lists, mappings, keys and single values, those of an alias counted at every use."""

MOST_DIGITS: Final = 1000
"""Largest number of characters of an integer: Python prints at most 4300 digits, and one in base 60 takes quadratic
time."""

MOST_DIRECTIVES: Final = 10
"""Largest number of lines that begin with %: the parser compares each tag directive with all before it."""

_LONGEST_QUOTED: Final = 80
_DIRECTIVE: Final = re.compile("(?:^|[\n\r\x85\u2028\u2029])%")
_INTEGER_TAG: Final = "tag:yaml.org,2002:int"
_FLOAT_TAG: Final = "tag:yaml.org,2002:float"

# Numbers of YAML 1.2, such as 1e3 and 0o17, which YAML 1.1 reads as texts; and numbers of YAML 1.1, of which those
# with another value in 1.2 (010, 1:30) are refused.
_NUMBERS: Final = {
    _INTEGER_TAG: re.compile(
        r"[-+]?(?:0b[01_]+|0o[0-7]+|0x[0-9a-fA-F_]+|0[0-9_]*|[1-9][0-9_]*(?::[0-5]?[0-9])*)\Z",
    ),
    _FLOAT_TAG: re.compile(
        r"(?:[-+]?(?:[0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)?|[-+]?[0-9][0-9_]*[eE][-+]?[0-9]+"
        r"|[-+]?[0-9][0-9_]*(?::[0-5]?[0-9])+\.[0-9_]*|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z",
    ),
}
_LEADING_ZERO: Final = re.compile("[-+]?0[0-9_]+")
_FIRST_OF_NUMBERS: Final = "-+.0123456789"

#: Safe loader, in C if PyYAML was built with it: 20 times faster on a specimen.
_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

#: Safe dumper, in C if PyYAML was built with it: 3 times faster; a sweep writes three documents for each point.
_SafeDumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

_WIDEST: Final = 2**31 - 1
"""Largest width that the dumper in C takes."""


def _resolvers(library: Any) -> dict[str, list[tuple[str, re.Pattern[str]]]]:
    """Return the patterns of PyYAML by first character, with the numbers as read here."""
    patterns: dict[str, list[tuple[str, re.Pattern[str]]]] = {
        first: [(tag, pattern) for tag, pattern in listed if tag not in _NUMBERS]
        for first, listed in library.yaml_implicit_resolvers.items()
    }
    for first in _FIRST_OF_NUMBERS:
        patterns[first] = [*_NUMBERS.items(), *patterns.get(first, [])]
    return patterns


class YamlError(ValueError):
    """Text that is not YAML as accepted here; the message is a clause that ends with the position."""


class _StrictLoader(_SafeLoader):
    """Loader that names the position of an unreadable date or number; `_check_extent` runs before it."""

    yaml_implicit_resolvers = _resolvers(_SafeLoader)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if isinstance(node, yaml.ScalarNode) and node.tag in _NUMBERS:
            _check_number(node)
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, ValueError) as error:
            # It looks like a date or a number and is not, or has such a tag.
            kind = node.tag.rpartition(":")[2]
            raise _marked(f"{_quoted(node.value)} cannot be read as {kind} ({error})", node) from error


class _StrictDumper(_SafeDumper):
    """Dumper that quotes a text which the loader would read as a number, such as "1e3"."""

    yaml_implicit_resolvers = _resolvers(_SafeDumper)


class _StrictPythonDumper(yaml.SafeDumper):
    """The same in Python, for texts with half a character, which the one in C cannot encode."""

    yaml_implicit_resolvers = _resolvers(yaml.SafeDumper)


def _check_number(node: yaml.ScalarNode) -> None:
    """Refuse an integer that is too long, and a number that YAML 1.1 reads in base 8 or 60."""
    value: str = node.value
    reason = ""
    if node.tag == _INTEGER_TAG and len(value) > MOST_DIGITS:
        reason = f"it has more than {MOST_DIGITS} digits"
    elif ":" in value:
        reason = "numbers in base 60 are not read; write it in base 10, or put a text in quotes"
    elif node.tag == _INTEGER_TAG and _LEADING_ZERO.fullmatch(value):
        sign, digits = value.rstrip(value.lstrip("-+")), value.lstrip("-+0_") or "0"
        reason = f"an integer does not begin with 0; write {sign}{digits}, or put a text in quotes"
    if reason:
        raise _marked(f"{_quoted(value)} cannot be read as {node.tag.rpartition(':')[2]} ({reason})", node)


def dump_yaml(content: Any, *, sort_keys: bool = False, flow: bool = False, width: float = 80) -> str:
    """Return the YAML text of a value; `parse_yaml` reads the same value from it.

    Parameters
    ----------
    content : Any
        Mappings, lists and single values.
    sort_keys : bool
        Whether the keys of mappings are sorted; otherwise they keep their order.
    flow : bool
        Whether lists and mappings are in brackets and braces.
    width : float
        Length in characters after which a line is continued on the next one.

    Returns
    -------
    str
        Text that ends with a line feed.
    """
    form: dict[str, Any] = {
        "sort_keys": sort_keys,
        "default_flow_style": flow,
        "width": int(min(width, _WIDEST)),
        "allow_unicode": True,
    }
    try:
        return yaml.dump(content, Dumper=_StrictDumper, **form)
    except UnicodeEncodeError:
        return yaml.dump(content, Dumper=_StrictPythonDumper, **form)


def read_yaml_text(path: Path) -> str:
    """Return the text of a YAML file.

    Parameters
    ----------
    path : Path
        Path of a regular file of at most `LARGEST_TEXT` bytes.

    Returns
    -------
    str
        Text whose lines end with a line feed only.

    Raises
    ------
    OSError
        If it cannot be read, is not a regular file or is larger; `strerror` names the reason.
    UnicodeDecodeError
        If it is not UTF-8.
    """
    # As in a file that is opened as text: every line ending becomes "\n".
    return read_regular(path, largest=LARGEST_TEXT).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")


def parse_yaml(text: str) -> Any:
    """Return the content of a YAML text.

    Parameters
    ----------
    text : str
        Text of one document, of at most `LARGEST_TEXT` characters.

    Returns
    -------
    Any
        Mappings, lists and single values; None for an empty text. An alias is the same object at every use.
        Numbers are those of YAML 1.2 (1e3 is 1000.0); yes, no, on and off are booleans, as in YAML 1.1.

    Raises
    ------
    YamlError
        If the text is not YAML, is too large, holds a key twice, an invalid date or number, is nested deeper than
        `DEEPEST`, or holds more than `MOST_VALUES` values or `LARGEST_TEXT` characters with its aliases expanded.
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
    """Size of a value with its aliases expanded."""

    values: int = 1
    characters: int = 0
    depth: int = 0
    scalar: str | None = None


@dataclass
class _Collection:
    """List or mapping whose end has not been read."""

    is_mapping: bool = False
    anchor: str | None = None
    extent: _Extent = field(default_factory=lambda: _Extent(depth=1))
    parts: int = 0
    keys: set[str] = field(default_factory=set)

    def add(self, part: _Extent, event: Any, *, above: int) -> None:
        """Add a value or key; `above` is the number of collections that contain this one."""
        if self.is_mapping and self.parts % 2 == 0 and part.scalar is not None:
            # YAML's own readers use the last of two equal keys without an error.
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
    """Refuse content that would be too large or too deep after loading, and duplicate keys."""
    # Extent of each anchor; None while its end has not been read.
    anchors: dict[str, _Extent | None] = {}
    # The first one is the stream of documents.
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
    # An undefined alias is refused when the text is loaded.
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
