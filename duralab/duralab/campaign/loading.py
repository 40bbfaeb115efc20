"""Reading of a campaign file: from YAML text to a checked `Campaign`, or an error sentence with the wrong key."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import Field, TypeAdapter, ValidationError

import duralab_settings
from duralab.campaign.file import Campaign
from duralab.campaign.target_edit import EditStep, SourceChannel
from duralab.errors import InputError
from duralab.near_files import did_you_mean
from duralab_gateway import CalculatedChannel
from duralab_settings import Section, SettingsError, YamlError, parse_yaml, read_yaml_text, with_new_keys

_SUFFIX = ".yaml"


def shipped_campaigns() -> list[str]:
    """Return the names of the campaigns shipped with the package."""
    entries = (files("duralab.campaign") / "shipped").iterdir()
    return sorted(entry.name.removesuffix(_SUFFIX) for entry in entries if entry.name.endswith(_SUFFIX))


def load_campaign(source: str | Path) -> Campaign:
    """Read and check a campaign file.

    Parameters
    ----------
    source : str or Path
        Path of a YAML file, or the name of a campaign shipped with the package, e.g. "front_axle_demo".

    Returns
    -------
    Campaign
        Campaign with `folder` and `text` of the file.

    Raises
    ------
    InputError
        `source` is not a path, the file does not exist, it is not YAML, or a key or value in it is not allowed.
    """
    if not isinstance(source, str | os.PathLike):
        raise InputError(
            f"The campaign is {source!r}; give the path of its file, or the name of a shipped one: "
            f"{', '.join(shipped_campaigns())}."
        )
    path = Path(source)
    # A folder may have the name, e.g. one with results.
    if not path.is_file() and str(source) in shipped_campaigns():
        text = (files("duralab.campaign") / "shipped" / f"{source}{_SUFFIX}").read_text(encoding="utf-8")
        # A shipped file is not in a folder of the user: its paths are relative to the working directory.
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

    `text`: YAML text of the file. `name`: Name of the file, for an error. `folder`: Folder of the file, where relative
    paths start.
    Returns: The checked campaign.
    Raises `InputError`: It is not YAML, or a key or value in it is not allowed.
    """
    content, remarks = today(
        parse_mapping(text, name=name, what="a campaign file", keys=Campaign.model_fields), name=name
    )
    try:
        campaign = Campaign.model_validate(content)
    except ValidationError as error:
        raise explained(error, name=f"{name}: ") from error
    return campaign.read_from(folder=folder, text=text, remarks=remarks)


def checked_steps(steps: Sequence[EditStep | Mapping[str, Any] | str]) -> tuple[EditStep, ...]:
    """Check a script's steps of the target editor, written as under `target.edit` of a campaign file.

    `steps`: Steps as models, mappings or names of steps without settings.
    Returns: The steps as models, in order.
    Raises `InputError`: A key or value is not allowed.
    """
    try:
        return TypeAdapter(tuple[EditStep, ...]).validate_python(tuple(steps))
    except ValidationError as error:
        raise explained(error, place=("target", "edit")) from error


def explained(
    error: ValidationError, *, name: str = "", place: tuple[str, ...] = (), is_part: bool = False
) -> InputError:
    """Return the error in a campaign or a part of one, as one sentence; see `duralab_settings.explained`."""
    return as_input_error(duralab_settings.explained(error, Campaign, name=name, place=place, is_part=is_part))


def as_input_error(error: SettingsError) -> InputError:
    """Convert an error of settings to an `InputError`."""
    return InputError(str(error), field=error.field)


def today(content: dict[Any, Any], *, name: str) -> tuple[dict[Any, Any], tuple[str, ...]]:
    """Rename old keys of settings; return them with remarks, raise InputError if a key has both names."""
    try:
        return with_new_keys(content, name=f"{name}: ")
    except SettingsError as error:
        raise as_input_error(error) from error


class ImportSettings(Section):
    """Import of a measured file; the keys are those under `target` of a campaign file."""

    channels: dict[str, SourceChannel] = Field(
        default_factory=dict,
        description="Channel of the file, with unit and sign, for each response; left out: the channel with the "
        "same name.",
    )
    calculated: tuple[CalculatedChannel, ...] = Field(
        default=(), strict=False, description="Calculated channels, from channels of the file; used like those."
    )
    edit: tuple[EditStep, ...] = Field(default=(), strict=False, description="Steps of editing, in this order.")


def load_import_settings(path: Path) -> ImportSettings:
    """Read and check the settings of an import.

    `path`: The YAML file.
    Returns: The checked settings.
    Raises `InputError`: The file cannot be read, is not YAML, or a key or value in it is not allowed.
    """
    text = read_text(path, what="a file of settings")
    content = parse_mapping(text, name=str(path), what="it", keys=ImportSettings.model_fields)
    try:
        return ImportSettings.model_validate(content)
    except ValidationError as error:
        raise explained(error, name=f"{path}: ", place=("target",)) from error


def read_text(path: Path, *, what: str) -> str:
    """Return the text of a file."""
    try:
        return read_yaml_text(path)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path} is not a text file in UTF-8 (byte {error.start}); {what} is YAML text, so save it as UTF-8."
        ) from error
    except FileNotFoundError as error:
        raise InputError(f"There is no file {str(path)!r}; give the path of {what}{did_you_mean(path)}") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}; correct its path or its rights.") from error


def parse_mapping(text: str, *, name: str, what: str, keys: Iterable[str]) -> dict[Any, Any]:
    """Return the mapping in a YAML text."""
    try:
        content = parse_yaml(text)
    except YamlError as error:
        raise InputError(f"{name} is not YAML: {error}; correct it there.") from error
    if not isinstance(content, dict):
        found = "is empty" if content is None else f"holds a {type(content).__name__}"
        raise InputError(f"{name} {found}; {what} holds the keys {', '.join(keys)}.")
    return content
