"""A service's configuration from a file and from the environment, which has the last word."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError, create_model

from duralab_bus.yaml_config import ConfigError, read_mapping
from duralab_settings import explain_validation

ENVIRONMENT_PREFIX: Final = "DURALAB__"
"""Begins every variable of a configuration: `DURALAB__BUS__LAB` is `lab` in `bus`. Lists and mappings are JSON."""

_DELIMITER: Final = "__"

ConfigT = TypeVar("ConfigT", bound=BaseModel)


def configured(config_type: type[ConfigT], path: Path | str | None) -> ConfigT:
    """Return a configuration: what stands in the environment, else in the file, else the default.

    `config_type`: The pydantic model it must fit. `path`: A YAML file with one mapping; the environment alone where not
    given.
    Returns: The checked configuration.
    Raises `ConfigError`: The file cannot be read or is not YAML, a variable is not JSON where it must be, or the whole
    does not fit; all that does not fit is named at once.
    """
    content: dict[str, Any] = {} if path is None else read_mapping(path)
    variables = {name: text for name, text in os.environ.items() if name.upper().startswith(ENVIRONMENT_PREFIX)}
    where = [str(path)] if path is not None else []
    if variables:
        content = _merged(content, _from_environment(config_type, variables))
        where.append(f"the environment ({', '.join(sorted(variables))})")
    try:
        return config_type.model_validate(content)
    except ValidationError as error:
        raise ConfigError(f"{' and '.join(where)}: {explain_validation(error, config_type).sentence}") from error


def _from_environment(config_type: type[BaseModel], variables: Mapping[str, str]) -> dict[str, Any]:
    # A tenth of a second to import; most processes have no such variable.
    from pydantic_settings import BaseSettings, EnvSettingsSource, SettingsError

    names = {name[len(ENVIRONMENT_PREFIX) :].split(_DELIMITER)[0].lower() for name in variables}
    unknown = sorted(names - config_type.model_fields.keys())
    if unknown and config_type.model_config.get("extra") != "ignore":
        raise ConfigError(
            f"The environment names {', '.join(f'{ENVIRONMENT_PREFIX}{name.upper()}' for name in unknown)}, which "
            f"this service does not know; known are {', '.join(config_type.model_fields)}."
        )
    # The same fields, none of them required: what is missing here may stand in the file.
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
    """Lay one mapping over another, level by level."""
    merged = dict(below)
    for name, value in above.items():
        under = merged.get(name)
        if isinstance(under, Mapping) and isinstance(value, Mapping):
            merged[name] = _merged(under, value)
        else:
            merged[name] = value
    return merged
