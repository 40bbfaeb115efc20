"""Reading a campaign file: from YAML text to a checked `Campaign`, or one sentence that names the wrong key."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, Field, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from duralab.campaign.file import Campaign
from duralab.campaign.target_edit import EditStep, SourceChannel
from duralab.campaign.values import ONE_NUMBER, PER_CHANNEL, Section
from duralab.errors import InputError
from duralab.near_files import did_you_mean
from strict_yaml import YamlError, parse_yaml, read_yaml_text

_SUFFIX = ".yaml"

# A file may be wrong in tens of thousands of places: a sentence names some of them, and keys and values by their start.
_MOST_FINDINGS = 20
_MOST_COMPARED = 200
_LONGEST_SHOWN = 60


def shipped_campaigns() -> list[str]:
    """Return the names of the campaigns that come with the package."""
    entries = (files("duralab.campaign") / "shipped").iterdir()
    return sorted(entry.name.removesuffix(_SUFFIX) for entry in entries if entry.name.endswith(_SUFFIX))


def load_campaign(source: str | Path) -> Campaign:
    """Read and check a campaign file.

    Parameters
    ----------
    source : str or Path
        Path of a YAML file, or the name of a campaign that comes with the package, e.g. "front_axle_demo".

    Returns
    -------
    Campaign
        With `folder` and `text` of the file.

    Raises
    ------
    InputError
        It is no path, there is no such file, it is no YAML, or a key or value in it is not allowed.
    """
    if not isinstance(source, str | os.PathLike):
        raise InputError(
            f"The campaign is {source!r}; give the path of its file, or the name of a shipped one: "
            f"{', '.join(shipped_campaigns())}."
        )
    path = Path(source)
    if not path.exists() and str(source) in shipped_campaigns():
        text = (files("duralab.campaign") / "shipped" / f"{source}{_SUFFIX}").read_text(encoding="utf-8")
        # A shipped file has no folder of the user's own: its relative paths start where the user stands.
        return parse_campaign(text, name=str(source), folder=Path())
    if not path.is_file():
        shipped = shipped_campaigns()
        raise InputError(
            f"There is no campaign file {str(source)!r}; give the path of one, or a shipped one: "
            f"{', '.join(shipped)}{did_you_mean(path, names=shipped)}"
        )
    text = read_text(path, what="a campaign")
    return parse_campaign(text, name=str(path), folder=path.parent)


def parse_campaign(text: str, *, name: str, folder: Path = Path()) -> Campaign:
    """Check the text of a campaign file; see `load_campaign`.

    Parameters
    ----------
    text : str
        YAML text of the file.
    name : str
        Name of the file, for an error.
    folder : Path
        Folder of the file, where relative paths start.

    Returns
    -------
    Campaign
        The checked campaign.

    Raises
    ------
    InputError
        It is not YAML, or a key or value in it is not allowed.
    """
    content = parse_mapping(text, name=name, what="a campaign file", keys=Campaign.model_fields)
    try:
        campaign = Campaign.model_validate(content)
    except ValidationError as error:
        raise explained(error, name=f"{name}: ") from error
    return campaign.read_from(folder=folder, text=text)


def checked_steps(steps: Sequence[EditStep | Mapping[str, Any] | str]) -> tuple[EditStep, ...]:
    """Check steps of a target editor that a script gives as they would stand under `target.edit` of a campaign file.

    Parameters
    ----------
    steps : iterable of EditStep or Mapping[str, Any] or str
        Steps as models, mappings or names of steps without settings.

    Returns
    -------
    tuple of EditStep
        The steps as models, in order.

    Raises
    ------
    InputError
        A key or value is not allowed.
    """
    try:
        return TypeAdapter(tuple[EditStep, ...]).validate_python(tuple(steps))
    except ValidationError as error:
        raise explained(error, place=("target", "edit")) from error


def explained(
    error: ValidationError, *, name: str = "", place: tuple[str, ...] = (), is_part: bool = False
) -> InputError:
    """Return what is wrong with a campaign, or with a part of one, in one sentence.

    Parameters
    ----------
    error : ValidationError
        What was found.
    name : str
        Begin of the sentence.
    place : tuple of str
        Keys of the campaign that lead to the part.
    is_part : bool
        Whether keys of the part itself may be missing.
    """
    findings = error.errors(include_url=False)
    if is_part:
        findings = [finding for finding in findings if finding["type"] != "missing" or len(finding["loc"]) > 1]
    for finding in findings:
        finding["loc"] = (*place, *finding["loc"])
    findings = _without_echoes(findings)
    sentence = "; ".join(_finding(finding) for finding in findings[:_MOST_FINDINGS])
    if (more := len(findings) - _MOST_FINDINGS) > 0:
        sentence += f"; {more} more are wrong"
    return InputError(f"{name}{sentence}{'' if sentence.endswith('?') else '.'}", field=_path(findings[0]["loc"]))


def _without_echoes(findings: list[ErrorDetails]) -> list[ErrorDetails]:
    """Leave out 'x is missing' where an unknown key is most likely x, misspelt."""
    meant = {
        (*finding["loc"][:-1], close[0])
        for finding in findings[:_MOST_COMPARED]
        if finding["type"] == "extra_forbidden"
        and (model := _model_at(finding["loc"][:-1])) is not None
        and (close := get_close_matches(str(finding["loc"][-1])[:_LONGEST_SHOWN], _keys(model), n=1))
    }
    return [finding for finding in findings if finding["type"] != "missing" or finding["loc"] not in meant]


def _finding(finding: ErrorDetails) -> str:
    """Put one of pydantic's findings into words: key path, value, what is allowed."""
    context = finding.get("ctx", {})
    location, value = tuple(p for p in finding["loc"] if p not in (ONE_NUMBER, PER_CHANNEL)), finding["input"]
    model, key = _model_at(location[:-1]), str(location[-1]) if location else ""
    keys = _keys(model) if model else {}
    description = keys[key].description if key in keys else None
    hint = f" ({description.rstrip('.')})" if description else ""
    match finding["type"]:
        case "extra_forbidden":
            return _unknown_key(location, model)
        case "missing":
            return f"{_path(location)} is missing{hint}"
        case "value_error":
            return f"{_path(location)} {context['error']}".strip()
        case "enum":
            return f"{_path(location)} is {_shown(value)}; allowed: {context['expected'].replace(' or ', ', ')}{hint}"
        case "string_pattern_mismatch":
            return f"{_path(location)} is {_shown(value)}; it must match {context['pattern']}{hint}"
        case _:
            wanted = finding["msg"].split("should ", maxsplit=1)[-1]
            return f"{_path(location)} is {_shown(value)}; it must {wanted}{hint}"


def _unknown_key(location: Sequence[int | str], model: type[BaseModel] | None) -> str:
    key, allowed = str(location[-1]), list(_keys(model)) if model else []
    place = f" in {_path(location[:-1])}" if location[:-1] else ""
    close = get_close_matches(key[:_LONGEST_SHOWN], allowed, n=1)
    guess = f"; did you mean {close[0]!r}?" if close else ""
    return f"unknown key {_shown(key)}{place}; allowed: {_listed(allowed)}{guess}"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}…"


def _listed(names: Sequence[str] | Mapping[str, object]) -> str:
    return ", ".join(names)


def _path(location: Sequence[int | str]) -> str:
    parts = (str(part) for part in location if part not in (ONE_NUMBER, PER_CHANNEL))
    return ".".join(part if len(part) <= _LONGEST_SHOWN else f"{part[: _LONGEST_SHOWN - 3]}…" for part in parts)


def _keys(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a section by the names that the file has for them."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _model_at(location: Sequence[int | str]) -> type[BaseModel] | None:
    """Return the section that stands at a place of the file, or None where no section does."""
    model: type[BaseModel] = Campaign
    named_by_user = False
    for part in location:
        # The place in a list, or a channel's name: the section is that of the list or of the mapping.
        if named_by_user or isinstance(part, int):
            named_by_user = False
            continue
        field = _keys(model).get(part)
        if field is None:
            return None
        candidates = (field.annotation, *get_args(field.annotation))
        section = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None)
        if section is None:
            return None
        model, named_by_user = section, get_origin(field.annotation) is dict
    return model


class ImportSettings(Section):
    """What is made of a measured file; the keys are those under `target` of a campaign file."""

    channels: dict[str, SourceChannel] = Field(
        default_factory=dict,
        description="Channel of the file, its unit and its sign for each response; left out: the one of its name.",
    )
    edit: tuple[EditStep, ...] = Field(default=(), strict=False, description="Steps of editing, one after the other.")


def load_import_settings(path: Path) -> ImportSettings:
    """Read and check the settings of an import.

    Parameters
    ----------
    path : Path
        The YAML file.

    Returns
    -------
    ImportSettings
        The checked settings.

    Raises
    ------
    InputError
        The file cannot be read, is no YAML, or a key or value in it is not allowed.
    """
    text = read_text(path, what="a file of settings")
    content = parse_mapping(text, name=str(path), what="it", keys=ImportSettings.model_fields)
    try:
        return ImportSettings.model_validate(content)
    except ValidationError as error:
        raise explained(error, name=f"{path}: ", place=("target",)) from error


def read_text(path: Path, *, what: str) -> str:
    """Return the text of a file.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it should be, e.g. "a campaign".

    Raises
    ------
    InputError
        It cannot be read, is no regular file, is larger than a YAML file may be, or is no text in UTF-8.
    """
    try:
        return read_yaml_text(path)
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file in UTF-8 (byte {error.start}); {what} is YAML text.") from error
    except FileNotFoundError as error:
        raise InputError(f"There is no file {str(path)!r}; give the path of {what}{did_you_mean(path)}") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from error


def parse_mapping(text: str, *, name: str, what: str, keys: Iterable[str]) -> dict[Any, Any]:
    """Return the mapping that a YAML text holds.

    Parameters
    ----------
    text : str
        The text.
    name : str
        Of the file, for an error.
    what : str
        What it should be, e.g. "a campaign file".
    keys : iterable of str
        What it may hold, for an error.

    Raises
    ------
    InputError
        It is no YAML, holds a key twice, or no mapping.
    """
    try:
        content = parse_yaml(text)
    except YamlError as error:
        raise InputError(f"{name} is not YAML: {error}.") from error
    if not isinstance(content, dict):
        found = "is empty" if content is None else f"holds a {type(content).__name__}"
        raise InputError(f"{name} {found}; {what} holds the keys {', '.join(keys)}.")
    return content
