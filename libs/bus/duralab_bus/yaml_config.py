"""Configuration files: YAML into a typed configuration, with errors in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from duralab_settings import YamlError, explain_validation, parse_yaml, read_yaml_text

ConfigT = TypeVar("ConfigT", bound=BaseModel)


class ConfigError(ValueError):
    """A configuration that cannot be used; the message is one sentence with file, field, value and what is allowed."""


def load_config(config_type: type[ConfigT], path: Path | str) -> ConfigT:
    """Read a configuration.

    Parameters
    ----------
    config_type : type
        The pydantic model it must fit.
    path : Path or str
        A YAML file with one mapping; an empty file is the default configuration.

    Returns
    -------
    ConfigT
        The configuration, checked.

    Raises
    ------
    ConfigError
        The file cannot be read, is not YAML, holds a key twice, or does not fit; all that does not fit is named at
        once.
    """
    content = read_mapping(path)
    try:
        return config_type.model_validate(content)
    except ValidationError as error:
        raise ConfigError(f"{path}: {explain_validation(error, config_type).sentence}") from error


def read_mapping(path: Path | str) -> dict[str, Any]:
    """Read the mapping of a YAML file, empty for an empty file; raises ConfigError where it holds none."""
    path = Path(path)
    try:
        text = read_yaml_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError(f"Cannot read the configuration {path}: {reason}.") from error
    try:
        content = parse_yaml(text)
    except YamlError as error:
        raise ConfigError(f"{path} is not YAML: {error}.") from error
    if content is not None and not isinstance(content, dict):
        raise ConfigError(f"{path} holds a {type(content).__name__}; it must hold a mapping of fields to values.")
    return content or {}
