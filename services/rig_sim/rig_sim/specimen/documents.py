"""A specimen's YAML as it stands, or with the YAML it is a variant of."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from duralab_settings import YamlError, parse_yaml, read_yaml_text

_VARIANT_OF = "variant_of"
_BESIDE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*\.yaml")


class SpecimenError(ValueError):
    """A specimen that cannot be used, in one sentence."""


def read_document(path: Path) -> Any:
    """Read a YAML file; where it says `variant_of: NAME.yaml`, with what that file beside it says.

    What a variant says is added to the other's lists and mappings, and takes the place of its single values.

    `path`: The YAML.
    Returns: What it says, not checked.
    Raises `SpecimenError`: Where a file is missing or not YAML, or a variant is of no file beside it, of another
    variant, or says another kind of thing under a key.
    """
    document = _read(path)
    base = _base(path, document)
    if base is None:
        return document
    other = _read(base)
    if not isinstance(other, dict) or _VARIANT_OF in other:
        raise SpecimenError(f"specimen {path.name}: {base.name} is itself a variant or no specimen; name a whole one.")
    changes = {key: value for key, value in document.items() if key != _VARIANT_OF}
    return _merged(other, changes, place=f"specimen {path.name}: ")


def document_files(path: Path) -> tuple[Path, ...]:
    """Return the files that a document is made of: its own, and the one it is a variant of.

    `path`: The YAML.
    Returns: One file or two.
    """
    base = _base(path, _read(path))
    return (path,) if base is None else (path, base)


def _base(path: Path, document: Any) -> Path | None:
    if not isinstance(document, dict) or _VARIANT_OF not in document:
        return None
    name = document[_VARIANT_OF]
    if not isinstance(name, str) or not _BESIDE.fullmatch(name):
        raise SpecimenError(f"specimen {path.name}: variant_of is {name!r}; it must name a YAML beside it, NAME.yaml.")
    return path.with_name(name)


def _merged(base: dict[Any, Any], changes: dict[Any, Any], *, place: str) -> dict[Any, Any]:
    merged = dict(base)
    for key, value in changes.items():
        old = merged.get(key)
        if isinstance(old, dict | list) and not isinstance(value, type(old)):
            kind = "a list" if isinstance(old, list) else "a mapping"
            raise SpecimenError(f"{place}{key} is {kind} in what it varies; give {kind} of what to add.")
        if isinstance(old, dict) and isinstance(value, dict):
            merged[key] = _merged(old, value, place=f"{place}{key}.")
        elif isinstance(old, list) and isinstance(value, list):
            merged[key] = [*old, *value]
        else:
            merged[key] = value
    return merged


def _read(path: Path) -> Any:
    try:
        return parse_yaml(read_yaml_text(path))
    except OSError as error:
        raise SpecimenError(f"specimen {path.name} cannot be read: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise SpecimenError(f"specimen {path.name} is not text in UTF-8.") from error
    except YamlError as error:
        raise SpecimenError(f"specimen {path.name} is not YAML: {error}.") from error
