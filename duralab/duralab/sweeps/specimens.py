"""Specimens with tolerances: a rig's YAML, changed for a point at dotted keys."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from duralab.errors import InputError, LabError
from duralab.sweeps.sweep_file import Sweep
from duralab_settings import dump_yaml, parse_yaml, read_yaml_text, require_regular

NAME = "name"
"""Key by which an entry of a list is found."""


def change(document: dict[str, Any], key: str, value: Any, *, what: str, add: bool = True) -> None:
    """Set the value of a dotted key."""
    parents, last = _parts(key, what=what)
    place: Any = document
    for depth, part in enumerate(parents):
        if add and isinstance(place, dict) and place.get(part) is None:
            place[part] = {}
        place = _step(place, part, key=key, depth=depth, what=what)
    if isinstance(place, dict) and add:
        place[last] = value
        return
    _step(place, last, key=key, depth=len(parents), what=what)
    place[last if isinstance(place, dict) else _index(place, last)] = value


def look_up(document: dict[str, Any], key: str, *, what: str) -> Any:
    """Return the value of a dotted key; raises InputError if it does not exist."""
    parents, last = _parts(key, what=what)
    place: Any = document
    for depth, part in enumerate([*parents, last]):
        place = _step(place, part, key=key, depth=depth, what=what)
    return place


def _parts(key: str, *, what: str) -> tuple[list[str], str]:
    *parents, last = key.split(".")
    if not all((*parents, last)):
        raise InputError(f"The key {key!r} of {what} has an empty part; write e.g. 'update.iteration_gain'.", field=key)
    return parents, last


def _step(place: Any, part: str, *, key: str, depth: int, what: str) -> Any:
    if isinstance(place, dict) and part in place:
        return place[part]
    if isinstance(place, list) and (index := _index(place, part)) >= 0:
        return place[index]
    there = ".".join(key.split(".")[:depth]) or "the top"
    raise InputError(
        f"The key {key!r} does not exist in {what}: at {there}, there is {_described(place)}; correct the key.",
        field=key,
    )


def _index(entries: list[Any], part: str) -> int:
    """Return the index of a list's entry by its name or number; -1 if there is none."""
    for row, entry in enumerate(entries):
        if isinstance(entry, dict) and entry.get(NAME) == part:
            return row
    return int(part) if part.isdecimal() and int(part) < len(entries) else -1


def _described(place: Any) -> str:
    if isinstance(place, dict):
        return ", ".join(map(str, place)) or "nothing"
    if isinstance(place, list):
        names = [str(entry.get(NAME, row)) if isinstance(entry, dict) else str(row) for row, entry in enumerate(place)]
        return ", ".join(names) or "an empty list"
    return f"the value {place!r}, which has no parts"


SPECIMEN: Final = "specimen"
"""Prefix of the key of a change to a specimen: `specimen.front_axle.struts.left_strut.law.stiffness`."""

_SECONDS: Final = 60.0
_BODIES: Final = "sdf"


@dataclass(frozen=True)
class SpecimenText:
    """Rig that is changed or not shipped; hashable, as part of the key of a cell.

    `bodies`: Name of the SDF or URDF file beside its YAML, if any; a worker may have no access to the file.
    """

    rig: str
    text: str
    bodies: str
    bodies_text: str

    @property
    def content(self) -> tuple[str, str]:
        """Content that determines the rig's responses."""
        return self.text, self.bodies_text

    def write(self, folder: Path) -> Path:
        """Write the specimen to a separate folder; return the path of its YAML."""
        own = folder / self.rig
        own.mkdir(parents=True, exist_ok=True)
        if self.bodies:
            (own / self.bodies).write_text(self.bodies_text, encoding="utf-8")
        path = own / f"{self.rig}.yaml"
        path.write_text(self.text, encoding="utf-8")
        return path


class Specimens:
    """Specimens of a sweep: its own files, and those shipped with the simulator."""

    def __init__(self, sweep: Sweep) -> None:
        self._own = {rig: sweep.folder / path for rig, path in sweep.specimens.items()}
        self._documents: dict[str, dict[str, Any]] = {}
        # Points that differ only in their campaign share the specimen.
        self._texts: dict[tuple[str, str], SpecimenText] = {}
        for rig, path in self._own.items():
            if not path.is_file():
                raise InputError(f"specimens.{rig} is {str(path)!r}, which is missing; give the rig's YAML.")
            name = self.document(rig).get("name")
            if name != rig:
                raise InputError(f"specimens.{rig} is {str(path)!r}, whose name is {name!r}; call it that.")

    @cached_property
    def _shipped(self) -> dict[str, Any]:
        """Shipped rigs of the simulator: path and resolved content of each YAML."""
        asked = [sys.executable, "-m", "rig_sim", "--specimens"]
        try:
            answer = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=_SECONDS).stdout
            return json.loads(answer)
        except (OSError, subprocess.SubprocessError, ValueError) as error:
            raise LabError(f"The simulator does not report which specimens it ships: {error}.") from error

    def document(self, rig: str) -> dict[str, Any]:
        """Return the content of a rig's YAML; raises InputError if there is no such rig."""
        if rig not in self._documents:
            self._documents[rig] = self._read(rig)
        return self._documents[rig]

    def _read(self, rig: str) -> dict[str, Any]:
        if rig in self._own:
            try:
                document = parse_yaml(read_yaml_text(self._own[rig]))
            except (OSError, ValueError) as error:
                reason = " ".join(str(error).split()).rstrip(".")
                raise InputError(
                    f"specimens.{rig} is {str(self._own[rig])!r}, which cannot be read: {reason}; correct the file."
                ) from error
            if not isinstance(document, dict):
                raise InputError(f"specimens.{rig} holds no keys; give the rig's YAML.")
            return document
        if rig not in self._shipped:
            known = ", ".join((*self._own, *self._shipped))
            raise InputError(f"There is no specimen {rig!r}; there are {known}.", field=f"{SPECIMEN}.{rig}")
        return self._shipped[rig]["document"]

    def of(
        self, rigs: Sequence[str], changes: Mapping[str, Mapping[str, Any]]
    ) -> tuple[tuple[str, ...], tuple[SpecimenText, ...]]:
        """Return the rigs that are used as shipped, and the texts of the others."""
        if idle := [rig for rig in changes if rig not in rigs]:
            raise InputError(
                f"{SPECIMEN}.{idle[0]} is changed; the campaign's rigs are {', '.join(rigs)}, so name one of them."
            )
        made = tuple(self._text_once(rig, changes.get(rig, {})) for rig in rigs if rig in self._own or rig in changes)
        return tuple(rig for rig in rigs if rig not in self._own and rig not in changes), made

    def _text_once(self, rig: str, changes: Mapping[str, Any]) -> SpecimenText:
        key = (rig, repr(sorted(changes.items())))
        if key not in self._texts:
            self._texts[key] = self._text(rig, changes)
        return self._texts[key]

    def _text(self, rig: str, changes: Mapping[str, Any]) -> SpecimenText:
        document = deepcopy(self.document(rig))
        # A copy of a shipped rig's YAML must contain the name, which otherwise follows from its file.
        document.setdefault("name", rig)
        for key, value in changes.items():
            change(document, key, value, what=f"specimen {rig}", add=False)
        bodies = str(document.get(_BODIES, ""))
        place = self._own[rig] if rig in self._own else Path(self._shipped[rig]["path"])
        beside = place.with_name(bodies) if bodies else place
        try:
            require_regular(beside)
            content = beside.read_text(encoding="utf-8") if bodies else ""
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(
                f"specimen {rig}: {bodies!r} belongs beside its YAML and cannot be read; save it there as UTF-8 text."
            ) from error
        return SpecimenText(rig, dump_yaml(document), bodies, content)
