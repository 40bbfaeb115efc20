"""Changed settings of a resumed campaign (whole file or changed keys) and of a decision at a hold point."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from duralab.campaign.file import Campaign
from duralab.campaign.loading import explained, load_campaign, parse_campaign, parse_mapping, read_text, today
from duralab.errors import InputError
from duralab_proto.v1 import iterator_pb2
from duralab_settings import ControlBandSettings, Section, StopCriteria, UpdateSection, dump_yaml, parse_yaml

_SECTIONS: Final = {"update": UpdateSection, "stop": StopCriteria, "control_band": ControlBandSettings}
_RESUMED: Final = ("update", "stop")
_DECIDED: Final = ("update", "control_band")


@dataclass(frozen=True)
class PartialSettings:
    """Keys of `update`, `stop` or `control_band` that replace those of a recorded campaign.

    `name`: Name of the file. `sections`: Some of these sections, each with only the changed keys. `remarks`: Keys of
    the file that have another name now.
    """

    name: str
    sections: dict[str, dict[str, Any]]
    remarks: tuple[str, ...] = ()


def load_settings(source: str | Path) -> Campaign | PartialSettings:
    """Read the settings for a resumed campaign.

    `source`: A YAML file with `update`, `stop` or both, each with the keys that change; or a whole campaign, as for
    `load_campaign`.
    Returns: Settings of which `update` and `stop` are used.
    Raises `InputError`: There is no such file, it is not YAML, or a key or value in it is not allowed.
    """
    if not isinstance(source, str | os.PathLike) or not Path(source).is_file():
        return load_campaign(source)
    name = str(source)
    what = "a file of settings to resume with"
    content = parse_mapping(read_text(Path(source), what=what), name=name, what=what, keys=_RESUMED)
    others = [str(key) for key in content if key not in _RESUMED]
    needed = [key for key, field in Campaign.model_fields.items() if field.is_required()]
    if others and any(key not in content for key in needed):
        raise InputError(
            f"{name} has {', '.join(others)}; settings to resume with are `update`, `stop` or both, or a whole "
            "campaign file.",
            field=others[0],
        )
    if others:
        return load_campaign(source)
    if not content:
        raise InputError(f"{name} is empty; give `update`, `stop` or both, with the keys that change.")
    return _partial(content, name=name)


def decision_settings(source: PartialSettings | Mapping[str, Any] | str | Path) -> PartialSettings:
    """Return the settings of a decision at a hold point.

    `source`: A YAML file or a mapping with `update`, `control_band` or both, each with the keys that change.
    Returns: Settings, checked as far as possible for a part of a section.
    Raises `InputError`: There is no such file, it is not YAML, or a key or value in it is not allowed.
    """
    if isinstance(source, PartialSettings):
        return source
    what, name = "a file of settings to change", "settings"
    if isinstance(source, Mapping):
        content = dict(source)
    elif isinstance(source, str | os.PathLike):
        name = str(source)
        content = parse_mapping(read_text(Path(source), what=what), name=name, what=what, keys=_DECIDED)
    else:
        raise InputError(f"settings is {source!r}; give a mapping, or the path of a file.", field="settings")
    others = [str(key) for key in content if key not in _DECIDED]
    if others or not content:
        found = f"has {', '.join(others)}" if others else "is empty"
        raise InputError(
            f"{name} {found}; at a hold point `update`, `control_band` or both change, with the keys that change.",
            field=others[0] if others else "settings",
        )
    return _partial(content, name=name)


def _partial(content: dict[Any, Any], *, name: str) -> PartialSettings:
    content, remarks = today(content, name=name)
    for section, keys in content.items():
        _require_known(section, keys, name=name)
    return PartialSettings(name, content, remarks)


def _require_known(section: str, keys: object, *, name: str) -> None:
    """Refuse unknown keys and values that are never allowed; missing keys are allowed."""
    try:
        _SECTIONS[section].model_validate(keys)
    except ValidationError as error:
        findings = [finding for finding in error.errors() if finding["type"] != "missing" or len(finding["loc"]) > 1]
        if findings:
            raise explained(error, name=f"{name}: ", place=(section,), is_part=True) from error


def completed(settings: PartialSettings, parent: iterator_pb2.CampaignSpec) -> Campaign:
    """Return the campaign file of a recorded campaign with the changed keys.

    `settings`: Changed keys. `parent`: Recorded specification, with its campaign file.
    Returns: Campaign whose `text` is the new file, without the comments of the old one.
    Raises `InputError`: The recording has no campaign file of this version, or a value is not allowed together with
    the unchanged ones.
    """
    recorded = _recorded_campaign(settings, parent)
    content, _ = today(dict(parse_yaml(recorded.text)), name=settings.name)
    for section, keys in settings.sections.items():
        content[section] = _merged(content[section], keys, model=_SECTIONS[section])
    try:
        campaign = Campaign.model_validate(content)
    except ValidationError as error:
        raise explained(error, name=f"{settings.name}, with what campaign {parent.id!r} has: ") from error
    changed = ", ".join(name for section, keys in settings.sections.items() for name in _names(section, keys))
    text = f"# Campaign {parent.id} with other settings: {changed}.\n"
    text += dump_yaml(content)
    return campaign.read_from(folder=Path(), text=text)


def _names(section: str, keys: dict[str, Any]) -> Iterator[str]:
    """Yield the dotted keys in a part of a section, including each key of a nested section."""
    for key, value in keys.items():
        nested = _is_section(_SECTIONS[section].model_fields[key].annotation) and isinstance(value, dict)
        yield from (f"{section}.{key}.{inner}" for inner in value) if nested else (f"{section}.{key}",)


def _is_section(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, Section)


def _merged(old: dict[str, Any], new: dict[str, Any], *, model: type[Section]) -> dict[str, Any]:
    """Return a section with changed keys; in a nested section, too, only the given keys change."""
    merged = {**old, **new}
    for key, field in model.model_fields.items():
        if _is_section(field.annotation) and key in old and key in new:
            merged[key] = {**old[key], **new[key]}
    return merged


def _recorded_campaign(settings: PartialSettings, parent: iterator_pb2.CampaignSpec) -> Campaign:
    whole = f"give a whole campaign file in place of {settings.name}, which holds only the keys that change"
    if not parent.scenario:
        raise InputError(f"The recording of campaign {parent.id!r} holds no campaign file; {whole}.", field="settings")
    try:
        return parse_campaign(parent.scenario, name=f"the campaign file of {parent.id!r}")
    except InputError as error:
        raise InputError(
            f"The campaign file in the recording of {parent.id!r} is not from this version ( "
            f"{error.message.rstrip('.')}); {whole}.",
            field="settings",
        ) from error
