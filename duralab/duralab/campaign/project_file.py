"""Project files: many events, with shared settings and settings per event."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from pydantic import Field, ValidationError

from duralab.campaign.file import Campaign
from duralab.campaign.loading import explained, parse_mapping, read_text, today
from duralab.errors import InputError
from duralab_settings import Section, YamlError, parse_yaml

_EVENTS: Final = "events"
_SHARED_ONLY: Final = ("excitation", "estimator", "seed", "start_from", "name")
"""Keys that an event cannot have, because all events of a rig share one identification."""


class EventSettings(Section):
    """Settings of an event in addition to those of its campaign."""

    priority: int = Field(default=0, ge=-1000, le=1000, description="Events of a higher priority come first.")
    repeats: int = Field(
        default=1, ge=1, le=10_000_000, description="Number of times that its drive is listed in the order file."
    )


@dataclass(frozen=True)
class Event:
    """Event: one target of a project.

    Parameters
    ----------
    name : str
        Name, unique within the project.
    campaign : Campaign
        Campaign of the event; its name is the project's and the event's, joined by a hyphen.
    settings : EventSettings
        Priority and repeats.
    """

    name: str
    campaign: Campaign
    settings: EventSettings


@dataclass(frozen=True)
class Project:
    """Events on one specimen, whose campaigns share an identification on each rig.

    Parameters
    ----------
    name : str
        Name of the project, with which its campaigns' names begin.
    events : tuple of Event
        Events in the order of the file.
    """

    name: str
    events: tuple[Event, ...]

    @property
    def rigs(self) -> tuple[str, ...]:
        """Rigs that the project needs: those of its events and those of the vehicles on roads."""
        return tuple(dict.fromkeys(rig for event in self.events for rig in event.campaign.rigs))


def shipped_projects() -> list[str]:
    """Return the names of the projects shipped with the package."""
    entries = (files("duralab.campaign") / "shipped_projects").iterdir()
    return sorted(entry.name.removesuffix(".yaml") for entry in entries if entry.name.endswith(".yaml"))


def is_project(source: str | Path) -> bool:
    """Return whether a file is a project, i.e. has the key `events`, or a name is that of a shipped project."""
    path = Path(source)
    if not path.is_file():
        return str(source) in shipped_projects()
    try:
        content = parse_yaml(read_text(path, what="a campaign or a project"))
    except (YamlError, InputError):
        return False
    return isinstance(content, dict) and _EVENTS in content


def load_project(source: str | Path) -> Project:
    """Read and check a project file.

    Parameters
    ----------
    source : str or Path
        Path of a YAML file, or the name of a project shipped with the package.

    Returns
    -------
    Project
        Project with a complete campaign for each event.

    Raises
    ------
    InputError
        There is no such file, it is not YAML, or a key or value in it is not allowed.
    """
    path = Path(source)
    if not path.is_file() and str(source) in shipped_projects():
        text = (files("duralab.campaign") / "shipped_projects" / f"{source}.yaml").read_text(encoding="utf-8")
        return parse_project(text, name=str(source))
    return parse_project(read_text(path, what="a project"), name=str(path), folder=path.parent)


def parse_project(text: str, *, name: str, folder: Path = Path()) -> Project:
    """Check the text of a project file; see `load_project`."""
    keys = [_EVENTS, *(key for key in Campaign.model_fields if key != "target")]
    content, _ = today(parse_mapping(text, name=name, what="a project file", keys=keys), name=name)
    events = content.pop(_EVENTS, None)
    if not isinstance(events, dict) or not events:
        raise InputError(f"{name} has no events; give `events` with a name and a `target` for each.", field=_EVENTS)
    project = content.get("name")
    if not isinstance(project, str):
        raise InputError(f"{name} has the name {project!r}; give a text, which names the project.", field="name")
    return Project(
        project, tuple(_event(str(event), own, content, name=name, folder=folder) for event, own in events.items())
    )


def _event(event: str, own: object, shared: dict[Any, Any], *, name: str, folder: Path) -> Event:
    place = f"{name}: {_EVENTS}.{event}"
    if not isinstance(own, dict):
        raise InputError(f"{place} is {own!r}; give a mapping with its `target`.", field=f"{_EVENTS}.{event}")
    taken = {key: value for key, value in own.items() if key not in EventSettings.model_fields}
    if shared_only := [key for key in taken if key in _SHARED_ONLY]:
        raise InputError(
            f"{place} has {', '.join(shared_only)}; all events share one identification of each rig, so state it "
            "for the whole project.",
            field=f"{_EVENTS}.{event}.{shared_only[0]}",
        )
    content = _merged(shared, taken) | {"name": f"{shared['name']}-{event}"}
    try:
        settings = EventSettings.model_validate({key: value for key, value in own.items() if key not in taken})
        campaign = Campaign.model_validate(content)
    except ValidationError as error:
        raise explained(error, name=f"{place}: ") from error
    campaign = campaign.read_from(folder=folder, text="")
    return Event(event, campaign.read_from(folder=folder, text=campaign.text), settings)


def _merged(shared: Mapping[Any, Any], own: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return the shared settings with an event's settings replacing them, key by key at every depth."""
    merged = dict(shared)
    for key, value in own.items():
        before = merged.get(key)
        merged[key] = _merged(before, value) if isinstance(before, Mapping) and isinstance(value, Mapping) else value
    return merged
