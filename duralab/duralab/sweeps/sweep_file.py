"""Sweep file: the campaign, and the settings that change from one run to the next."""

from __future__ import annotations

from enum import StrEnum
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Discriminator, Field, PrivateAttr, Tag, model_validator

from duralab.errors import InputError
from duralab.near_files import did_you_mean
from duralab_bus import ConfigError, load_config
from duralab_settings import Section, Seed, new_key, read_yaml_text, remarks_on

MOST_POINTS = 100_000
"""Maximum number of points of a sweep: all settings are made and checked before the first is run."""

Number = Annotated[float, Field(allow_inf_nan=False)]
Setting = Any
"""Value of a key of a campaign file; checked with the campaign file."""

Settings = dict[str, Setting]
"""Settings by their dotted keys."""


class CellKind(StrEnum):
    """Kind of cell in which a task runs its campaign."""

    PROCESS = "process"
    """Services in the worker's process, on a private bus: no message leaves it."""
    LAB = "lab"
    """Private lab with a process for each service, on loopback."""


class Kept(StrEnum):
    """Data kept of each campaign."""

    RECORDINGS = "recordings"
    FIGURES = "figures"


class Objective(StrEnum):
    """Error by which campaigns are compared; smaller is better."""

    OVERALL_ERROR = "overall_error"
    """Relative RMS error over all judged channels, of the best playback."""
    WORST_ERROR = "worst_error"
    """Largest relative RMS error of a judged channel, of the best playback."""


class Counted(Section):
    """Consecutive whole numbers, e.g. seeds."""

    start: Seed = Field(alias="from", description="First seed.")
    count: int = Field(ge=1, le=MOST_POINTS, description="Number of seeds.")


class Scaled(Section):
    """Multiples of the number in the file."""

    scale: tuple[Number, ...] = Field(min_length=1, strict=False, description="Factors, e.g. [0.9, 1.0, 1.1].")


Listed = Annotated[tuple[Setting, ...], Field(min_length=1, strict=False)]


def _way_of_an_axis(given: object) -> str:
    if isinstance(given, dict):
        return "scale" if "scale" in given else "row"
    return "scale" if isinstance(given, Scaled) else "row" if isinstance(given, Counted) else "values"


Axis = Annotated[
    Annotated[Listed, Tag("values")] | Annotated[Counted, Tag("row")] | Annotated[Scaled, Tag("scale")],
    Discriminator(_way_of_an_axis),
]
"""Listed values, consecutive whole numbers, or multiples of the value in the file."""


class SearchedRange(Section):
    """Numbers between two bounds."""

    lowest: Number = Field(alias="from", description="Lower bound.")
    highest: Number = Field(alias="to", description="Upper bound.")
    whole: bool = Field(default=False, description="Whole numbers only.")
    logarithmic: bool = Field(default=False, description="Uniform on a logarithmic scale; both bounds must be above 0.")

    @model_validator(mode="after")
    def _check_bounds(self) -> Self:
        if not self.lowest < self.highest:
            raise ValueError(f"reaches from {self.lowest:g} to {self.highest:g}; the first must be below the second")
        if self.logarithmic and self.lowest <= 0:
            raise ValueError(f"is logarithmic and begins at {self.lowest:g}; it must begin above 0")
        if self.whole and not (self.lowest.is_integer() and self.highest.is_integer()):
            raise ValueError(f"is of whole numbers and reaches from {self.lowest:g} to {self.highest:g}")
        return self


class SearchedChoice(Section):
    """One of some values."""

    choices: tuple[bool | int | float | str, ...] = Field(min_length=2, strict=False, description="The values.")


def _way_of_a_search(given: object) -> str:
    chosen = isinstance(given, SearchedChoice) or (isinstance(given, dict) and "choices" in given)
    return "choices" if chosen else "bounds"


Searched = Annotated[
    Annotated[SearchedRange, Tag("bounds")] | Annotated[SearchedChoice, Tag("choices")], Discriminator(_way_of_a_search)
]
"""Bounds or choices."""


class Search(Section):
    """Search for settings with the smallest error, by a tree-structured Parzen estimator."""

    settings: dict[str, Searched] = Field(min_length=1, description="Bounds (from, to) or choices, by dotted key.")
    budget: int = Field(ge=1, le=MOST_POINTS, description="Total number of campaigns; each point below costs one.")
    seed: Seed = Field(description="Seed of the search.")
    startup: int = Field(default=10, ge=1, description="Number of settings drawn at random before the search begins.")
    together: int = Field(
        default=4,
        ge=1,
        le=1000,
        description="Number of settings tried at the same time, regardless of the number of workers.",
    )
    minimise: Objective = Field(
        default=Objective.OVERALL_ERROR,
        strict=False,
        description="Figure to minimise; its mean if axes are given, too.",
    )


class Sweep(Section):
    """Content of a sweep file."""

    name: str = Field(
        pattern=r"^[a-z0-9][a-z0-9_-]{0,39}$",
        description="Name of the sweep and its folder: lower case letters, digits, '-' and '_'.",
    )
    campaign: str = Field(description="A campaign file, relative to this one, or a shipped campaign.")
    settings: Settings = Field(default_factory=dict, description="Settings that differ from that file in every run.")
    specimens: dict[str, Annotated[Path, Field(strict=False)]] = Field(
        default_factory=dict, description="YAML files of rigs that are not shipped, by the rig's name."
    )
    points: tuple[Settings, ...] = Field(
        default=(), strict=False, description="Settings that change together, one point for each entry."
    )
    axes: dict[str, Axis] = Field(default_factory=dict, description="Values by dotted key; all combinations are run.")
    search: Search | None = Field(default=None, description="Search for the best settings.")
    cell: CellKind = Field(
        default=CellKind.PROCESS,
        strict=False,
        description="Environment of a task: process is quicker, lab starts a real lab.",
    )
    keep: Kept = Field(
        default=Kept.RECORDINGS, strict=False, description="recordings of every campaign, or its figures only."
    )
    compare_by: Objective = Field(
        default=Objective.OVERALL_ERROR, strict=False, description="Figure by which the report compares."
    )

    _folder: Path = PrivateAttr(default=Path())
    _text: str = PrivateAttr(default="")

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remark on the file, one sentence: dotted keys that were renamed."""
        searched = self.search.settings if self.search else {}
        points = (key for point in self.points for key in point)
        return remarks_on(dict.fromkeys([*self.settings, *points, *self.axes, *searched]))

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        groups = [("settings", self.settings), ("axes", self.axes), *(("points", point) for point in self.points)]
        if self.search is not None:
            groups.append(("search.settings", self.search.settings))
        for place, keys in groups:
            if "name" in keys:
                raise ValueError(
                    f"{place} changes name; every campaign of a sweep is named after its point, so leave it out"
                )
        varied = [
            {new_key(key) for key in keys}
            for keys in (self.axes, set().union(*self.points), self.search.settings if self.search else ())
        ]
        twice = (varied[0] & varied[1]) | (varied[0] & varied[2]) | (varied[1] & varied[2])
        if twice:
            raise ValueError(f"varies {', '.join(sorted(twice))} in two of axes, points and search; one is enough")
        if any(set(point) != set(self.points[0]) for point in self.points):
            raise ValueError("has points with different keys; name the same keys in each")
        if not any(varied):
            raise ValueError("has no axes, no points and no search; name what changes from one campaign to the next")
        return self

    @property
    def folder(self) -> Path:
        """Folder to which the file's paths are relative."""
        return self._folder

    @property
    def text(self) -> str:
        """Exact text of the file."""
        return self._text

    def read_from(self, *, folder: Path, text: str) -> Self:
        """Return this sweep with the folder and the text of its file."""
        copy = self.model_copy()
        copy._folder = folder  # noqa: SLF001  (its own private attribute, on its own copy)
        copy._text = text  # noqa: SLF001
        return copy


_SUFFIX = ".yaml"


def shipped_sweeps() -> list[str]:
    """Return the names of the sweeps shipped with the package."""
    entries = (files("duralab.sweeps") / "shipped").iterdir()
    return sorted(entry.name.removesuffix(_SUFFIX) for entry in entries if entry.name.endswith(_SUFFIX))


def load_sweep(source: str | Path) -> Sweep:
    """Read and check a sweep file, given by its path or by the name of a shipped sweep."""
    path = Path(source)
    if not path.exists() and str(source) in shipped_sweeps():
        # A shipped file is not in a folder of the user: its paths are relative to the working directory.
        with as_file(files("duralab.sweeps") / "shipped" / f"{source}{_SUFFIX}") as shipped:
            return _read(shipped, folder=Path())
    if not path.is_file():
        names = shipped_sweeps()
        raise InputError(
            f"There is no sweep file {str(source)!r}; give the path of one, or a shipped one: "
            f"{', '.join(names)}{did_you_mean(path, names=names)}"
        )
    return _read(path, folder=path.parent)


def _read(path: Path, *, folder: Path) -> Sweep:
    try:
        sweep = load_config(Sweep, path)
    except ConfigError as error:
        raise InputError(str(error)) from error
    return sweep.read_from(folder=folder, text=read_yaml_text(path))
