"""The settings of an import: which channel of a measured file is which response, and what is done with them."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, ValidationError

from duralab.campaign_loading import explained
from duralab.campaign_values import Section
from duralab.settings_text import parse_mapping, read_text
from duralab.target_edit_section import EditStep, SourceChannel


class ImportSettings(Section):
    """What is made of a measured file; the keys are those under `target` of a campaign file."""

    channels: dict[str, SourceChannel] = Field(
        default_factory=dict,
        description="Channel of the file, its unit and its sign for each response; left out: the one of its name.",
    )
    edit: tuple[EditStep, ...] = Field(default=(), strict=False, description="Steps of editing, one after the other.")


def load_import_settings(path: Path) -> ImportSettings:
    """Read and check the settings of an import.

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
