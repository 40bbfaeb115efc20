"""Configuration from a file and from the environment, which takes precedence: errors in one sentence."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError, create_model

from duralab_settings import YamlError, explain_validation, parse_yaml, read_yaml_text

ConfigT = TypeVar("ConfigT", bound=BaseModel)


class ConfigError(ValueError):
    """A configuration that cannot be used; the message is one sentence with file, field, value and allowed values."""


def load_config(config_type: type[ConfigT], path: Path | str) -> ConfigT:
    """Read a configuration.

    Parameters
    ----------
    config_type : type
        Pydantic model of the configuration.
    path : Path or str
        YAML file with one mapping; an empty file is the default configuration.

    Returns
    -------
    ConfigT
        Checked configuration.

    Raises
    ------
    ConfigError
        The file cannot be read, is not YAML, holds a key twice, or does not fit; all errors are named at once.
    """
    return _checked(config_type, read_mapping(path), where=str(path))


def _checked(config_type: type[ConfigT], content: dict[str, Any], *, where: str) -> ConfigT:
    try:
        return config_type.model_validate(content)
    except ValidationError as error:
        raise ConfigError(f"{where}: {explain_validation(error, config_type).sentence}") from error


def read_mapping(path: Path | str) -> dict[str, Any]:
    """Read the mapping of a YAML file, empty for an empty file; raises ConfigError if it holds something else."""
    path = Path(path)
    try:
        text = read_yaml_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError(f"Cannot read the configuration {path}: {reason}; correct its path or its rights.") from error
    try:
        content = parse_yaml(text)
    except YamlError as error:
        raise ConfigError(f"{path} is not YAML: {error}.") from error
    if content is not None and not isinstance(content, dict):
        raise ConfigError(f"{path} holds a {type(content).__name__}; it must hold a mapping of fields to values.")
    return content or {}


ENVIRONMENT_PREFIX: Final = "DURALAB__"
"""Prefix of every variable of a configuration: `DURALAB__BUS__LAB` is `lab` in `bus`. Lists and mappings are JSON."""

_DELIMITER: Final = "__"


def configured(config_type: type[ConfigT], path: Path | str | None) -> ConfigT:
    """Return a configuration: values from the environment, else from the file if given, else the defaults.

    Raises `ConfigError`: The file cannot be read or is not YAML, a variable is not JSON where it must be, or the
    configuration does not fit; all errors are named at once.
    """
    content: dict[str, Any] = {} if path is None else read_mapping(path)
    variables = {name: text for name, text in os.environ.items() if name.upper().startswith(ENVIRONMENT_PREFIX)}
    where = [str(path)] if path is not None else []
    if variables:
        content = _merged(content, _from_environment(config_type, variables))
        where.append(f"the environment ({', '.join(sorted(variables))})")
    return _checked(config_type, content, where=" and ".join(where))


def _from_environment(config_type: type[BaseModel], variables: Mapping[str, str]) -> dict[str, Any]:
    # The import takes 0.1 s; most processes have no such variable.
    from pydantic_settings import BaseSettings, EnvSettingsSource, SettingsError

    names = {name[len(ENVIRONMENT_PREFIX) :].split(_DELIMITER)[0].lower() for name in variables}
    unknown = sorted(names - config_type.model_fields.keys())
    if unknown and config_type.model_config.get("extra") != "ignore":
        raise ConfigError(
            f"The environment names {', '.join(f'{ENVIRONMENT_PREFIX}{name.upper()}' for name in unknown)}, which "
            f"this service does not know; known are {', '.join(config_type.model_fields)}."
        )
    # The same fields, none of them required: a missing value may be in the file.
    fields: dict[str, Any] = {name: (field.annotation, None) for name, field in config_type.model_fields.items()}
    settings = create_model("Environment", __base__=BaseSettings, **fields)
    source = EnvSettingsSource(settings, env_prefix=ENVIRONMENT_PREFIX, env_nested_delimiter=_DELIMITER)
    try:
        return source()
    except SettingsError as error:
        raise ConfigError(
            f"{error} of {', '.join(sorted(variables))}; lists and mappings are written as JSON."
        ) from error


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Merge one mapping over another, level by level."""
    merged = dict(below)
    for name, value in above.items():
        under = merged.get(name)
        if isinstance(under, Mapping) and isinstance(value, Mapping):
            merged[name] = _merged(under, value)
        else:
            merged[name] = value
    return merged
