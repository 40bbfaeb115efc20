"""The campaign file's reference, from the models that check it."""

from __future__ import annotations

from typing import Any

from table_cells import cell

from duralab.campaign import Campaign, shipped_campaigns

_BOUNDS = {
    "exclusiveMinimum": "above {}",
    "minimum": "{} or more",
    "exclusiveMaximum": "below {}",
    "maximum": "up to {}",
}
_LENGTHS = {"minItems": "at least {} of them", "maxItems": "at most {} of them"}


def campaign_file_page() -> str:
    """Return the page: every key of every section, with type, default and allowed values."""
    schema = Campaign.model_json_schema(by_alias=True)
    definitions = schema["$defs"]
    parts = [
        "# Campaign file\n",
        "Every key of a campaign's YAML, made from the models that check it. A key that stands twice, is not known or "
        "has a value that is not allowed is refused in one sentence. Commented examples are the campaigns that ship: "
        + ", ".join(f"`{name}`" for name in shipped_campaigns())
        + "; `targets` and `iteration` of the [guides](../guides/targets.md) say what to choose.\n",
        "## The file\n",
        *_table(schema, definitions),
    ]
    sections = {name: part for name, part in definitions.items() if "properties" in part}
    for name, part in sections.items():
        parts += [f"## {name} {{ #{_anchor(name)} }}\n", f"{part.get('description', '')}\n", *_table(part, definitions)]
    for name, part in definitions.items():
        if "enum" in part:
            values = ", ".join(f"`{value}`" for value in part["enum"])
            parts += [f"## {name} {{ #{_anchor(name)} }}\n", f"{part.get('description', '')} One of {values}.\n"]
    return "\n".join(parts)


def _table(part: dict[str, Any], definitions: dict[str, Any]) -> list[str]:
    required = part.get("required", [])
    rows = ["| key | value | default | |", "| --- | --- | --- | --- |"]
    for key, value in part["properties"].items():
        default = "required" if key in required else _default(value)
        rows.append(f"| `{key}` | {_type(value, definitions)} | {default} | {cell(value.get('description', ''))} |")
    return [*rows, ""]


def _default(value: dict[str, Any]) -> str:
    default = value.get("default")
    if default is None or default in ([], {}):
        return ""
    return "set" if isinstance(default, dict) else f"`{str(default).lower() if isinstance(default, bool) else default}`"


def _type(value: dict[str, Any], definitions: dict[str, Any]) -> str:
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        return _choices(definitions[name]["enum"]) if "enum" in definitions[name] else f"[{name}](#{_anchor(name)})"
    alternatives = value.get("anyOf", value.get("oneOf", value.get("allOf")))
    if alternatives is not None:
        kinds = [_type(kind, definitions) for kind in alternatives if kind.get("type") != "null"]
        return ", or ".join(dict.fromkeys(kinds))
    if "enum" in value or "const" in value:
        return _choices(value.get("enum", [value.get("const")]))
    if value.get("type") == "array":
        return _array(value, definitions)
    return _object(value, definitions) if value.get("type") == "object" else _scalar(value)


def _choices(values: list[Any]) -> str:
    return ", ".join(f"`{value}`" for value in values)


def _object(value: dict[str, Any], definitions: dict[str, Any]) -> str:
    inner = value.get("additionalProperties")
    return f"by name: {_type(inner, definitions)}" if isinstance(inner, dict) else "by name"


def _scalar(value: dict[str, Any]) -> str:
    words = {"number": "number", "integer": "whole number", "string": "text", "boolean": "`true` or `false`"}
    kind = value.get("type", "")
    bounds = [text.format(f"{value[bound]:g}") for bound, text in _BOUNDS.items() if bound in value]
    return ", ".join([words.get(kind, kind), *bounds])


def _array(value: dict[str, Any], definitions: dict[str, Any]) -> str:
    if "prefixItems" in value:
        return "[" + "; ".join(_type(item, definitions) for item in value["prefixItems"]) + "]"
    lengths = [text.format(value[length]) for length, text in _LENGTHS.items() if length in value]
    return ", ".join([f"list of {_type(value.get('items', {}), definitions)}", *lengths])


def _anchor(name: str) -> str:
    return name.lower()
