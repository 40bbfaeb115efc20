"""Configuration files: YAML into a typed configuration, with errors in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError

from strict_yaml import YamlError, parse_yaml, read_yaml_text

ConfigT = TypeVar("ConfigT", bound=BaseModel)

# A file may be wrong in tens of thousands of places: a sentence names some of them, and keys and values by their start.
_MOST_FINDINGS: Final = 20
_LONGEST_SHOWN: Final = 80


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
        raise ConfigError(f"{path}: {explain_validation(error, config_type)}") from error


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


def explain_validation(error: ValidationError, config_type: type[BaseModel]) -> str:
    """Return a pydantic error as one sentence that names every wrong field, its value and what is allowed.

    Parameters
    ----------
    error : ValidationError
        As pydantic raised it.
    config_type : type
        The model that it was raised for.

    Returns
    -------
    str
        One sentence; beyond 20 findings it says how many more there are.
    """
    findings = []
    details = error.errors(include_url=False)
    for detail in details[:_MOST_FINDINGS]:
        field = ".".join(_cut(str(part)) for part in detail["loc"])
        if detail["type"] == "extra_forbidden":
            known = ", ".join(config_type.model_fields) if len(detail["loc"]) == 1 else ""
            findings.append(f"{field} is unknown{f' (known are {known})' if known else ''}")
            continue
        reason = detail["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, ")
        if detail["type"] == "missing":
            findings.append(f"{field} is missing")
        elif field and detail["type"] != "value_error":
            findings.append(f"{field} is {_shortened(detail['input'])}: {reason[:1].lower()}{reason[1:]}")
        else:
            findings.append(f"{field}: {reason}" if field else reason)
    if (more := len(details) - _MOST_FINDINGS) > 0:
        findings.append(f"{more} more are wrong")
    return "; ".join(findings) + "."


def _shortened(value: object) -> str:
    return _cut(repr(value))


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"
