"""Conversion of a sweep file to its points, each a complete campaign, all checked before the first is run."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from duralab.campaign import Campaign, load_campaign, parse_campaign
from duralab.errors import InputError
from duralab.sweeps.specimens import SPECIMEN, Specimens, SpecimenText, change, look_up
from duralab.sweeps.sweep_file import MOST_POINTS, Counted, Scaled, Settings, Sweep
from duralab_settings import HoldPoint, dump_yaml, new_key, open_regular, parse_yaml, with_new_keys

_DISTRIBUTIONS: Final = (
    "duralab",
    "duralab-gateway",
    "duralab-identifier",
    "duralab-iterator",
    "duralab-bus",
    "duralab-drive-map",
    "duralab-loads",
    "duralab-proto",
    "duralab-recorder",
    "duralab-rig-sim",
    "duralab-roads",
    "duralab-spectra",
    "duralab-settings",
    "drake",
    "llvmlite",
    "numpy",
    "scipy",
)
"""Packages that compute drives and responses."""

DIGITS: Final = 16
"""Digits of a point's name: of 100,000 points, two have the same name in one of 3.7 billion sweeps."""


def installed_versions() -> Mapping[str, str]:
    """Return the versions of the packages that compute drives and responses, without importing them."""
    found = {}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return MappingProxyType(found)


def point_id(
    campaign: Mapping[str, Any],
    *,
    files: Mapping[str, str],
    specimens: Mapping[str, Any],
    versions: Mapping[str, str],
) -> str:
    """Return the name of a point, which is unique for its settings and versions."""
    content = {"campaign": campaign, "files": files, "specimens": specimens, "versions": dict(versions)}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


_PATHS: Final = ("target.file", "target.opencrg.path")
"""Keys of a campaign file with paths relative to it."""


@dataclass(frozen=True)
class Point:
    """Campaign of a sweep: its file with absolute paths, its shipped rigs, and its other specimens.

    `settings`: Settings that may differ between points, by dotted key.
    """

    id: str
    settings: Mapping[str, Any]
    campaign: str
    rigs: tuple[str, ...]
    specimens: tuple[SpecimenText, ...]

    @property
    def cell(self) -> tuple[object, ...]:
        """Key of the rig cell: points with the same key can follow each other in one cell."""
        return (self.rigs, self.specimens)


class PointMaker:
    """Maker of points from settings, which change a sweep's campaign and specimens."""

    def __init__(self, sweep: Sweep) -> None:
        self._sweep = sweep
        named = sweep.folder / sweep.campaign
        self._base = load_campaign(named if named.is_file() else sweep.campaign)
        # Only the parsed document gets the new names of keys, which the dotted keys use too; the text is unchanged.
        self._document, _ = with_new_keys(parse_yaml(self._base.text))
        self._specimens = Specimens(sweep)
        self._versions = installed_versions()
        self._hashes: dict[Path, str] = {}
        for key, value in sweep.settings.items():
            self._put(self._document, {}, key, value)

    def make(self, settings: Mapping[str, Any]) -> Point:
        """Return the point of given settings; raises InputError if its campaign or specimen is not allowed."""
        document, changes = deepcopy(self._document), dict[str, dict[str, Any]]()
        resolved: dict[str, Any] = {}
        for key, value in settings.items():
            resolved[key] = self._put(document, changes, key, value)
        described = ", ".join(f"{key}: {value}" for key, value in resolved.items())
        place = f"sweep {self._sweep.name}, point ({described})"
        document["name"] = self._sweep.name
        plan = parse_campaign(dump_yaml(document), name=place, folder=self._base.folder)
        if plan.hold is not None and plan.hold.when is not HoldPoint.NEVER:
            raise InputError(
                f"{place}: hold is {plan.hold.model_dump()}, and a sweep has no person who decides; give never, or "
                "leave it out.",
                field="hold",
            )
        rigs, specimens = self._specimens.of(plan.rigs, changes)
        id = point_id(
            _without_paths(plan),
            files=self._files(plan, place=place),
            specimens={specimen.rig: specimen.content for specimen in specimens},
            versions=self._versions,
        )
        for key in _PATHS:
            _make_absolute(document, key, folder=self._base.folder)
        document["name"] = f"{self._sweep.name}-{id}"
        return Point(id, resolved, dump_yaml(document), rigs, specimens)

    def _put(self, document: dict[str, Any], changes: dict[str, dict[str, Any]], key: str, value: Any) -> Any:
        """Change a campaign or note a change of a specimen; return the new value."""
        head, _, rest = key.partition(".")
        if head == SPECIMEN:
            rig, _, inner = rest.partition(".")
            if isinstance(value, Multiple):
                value = value.of(look_up(self._specimens.document(rig), inner, what=f"specimen {rig}"), key=key)
            changes.setdefault(rig, {})[inner] = value
            return value
        place = new_key(key)
        if isinstance(value, Multiple):
            value = value.of(look_up(document, place, what="the campaign"), key=key)
        change(document, place, value, what="the campaign")
        return value

    def _files(self, plan: Campaign, *, place: str) -> dict[str, str]:
        named = {"target.file": plan.target.file, "target.opencrg": plan.target.opencrg and plan.target.opencrg.path}
        return {key: self._hash(plan.folder / path, place=place) for key, path in named.items() if path is not None}

    def _hash(self, path: Path, *, place: str) -> str:
        if path not in self._hashes:
            try:
                with open_regular(path) as stream:
                    self._hashes[path] = hashlib.file_digest(stream, "sha256").hexdigest()
            except OSError as error:
                raise InputError(
                    f"{place}: the target's file {path} cannot be read: {error.strerror}; correct its path."
                ) from error
        return self._hashes[path]


@dataclass(frozen=True)
class Multiple:
    """Multiple of the number in the file."""

    factor: float

    def of(self, number: object, *, key: str) -> float:
        """Return the product; raises InputError if `number` is not a number."""
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise InputError(
                f"axes.{key} scales {number!r}; only a number can be scaled, so list the values.", field=key
            )
        return self.factor * number


def grid(sweep: Sweep) -> Iterator[Settings]:
    """Yield the settings of every point: each listed point with all values of all axes, the last axis fastest."""
    axes = [[(key, value) for value in _values(axis)] for key, axis in sweep.axes.items()]
    for point in sweep.points or ({},):
        for combination in itertools.product(*axes):
            yield {**point, **dict(combination)}


def grid_size(sweep: Sweep) -> int:
    """Return the number of settings that `grid` yields; raises InputError if there are too many."""
    size = max(1, len(sweep.points))
    for axis in sweep.axes.values():
        size *= len(_values(axis))
    if size > MOST_POINTS:
        raise InputError(
            f"The axes of sweep {sweep.name!r} have {size} points; {MOST_POINTS} are allowed, so divide it."
        )
    return size


def _values(axis: Sequence[Any] | Counted | Scaled) -> Sequence[Any]:
    if isinstance(axis, Counted):
        return range(axis.start, axis.start + axis.count)
    return [Multiple(factor) for factor in axis.scale] if isinstance(axis, Scaled) else axis


def _without_paths(plan: Campaign) -> dict[str, Any]:
    content = plan.model_dump(mode="json", exclude={"name", "hold"})
    content["target"].pop("file")
    if content["target"]["opencrg"] is not None:
        content["target"]["opencrg"].pop("path")
    return content


def _make_absolute(document: dict[str, Any], key: str, *, folder: Path) -> None:
    *parents, last = key.split(".")
    place: Any = document
    for part in parents:
        place = place.get(part) or {}
    if place.get(last) is not None:
        place[last] = str((folder / place[last]).resolve())
