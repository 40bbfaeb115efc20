"""YAML as the lab takes it, for every reader of a file: rigs, campaigns, sweeps and configurations."""

from strict_yaml.reading import LARGEST_TEXT, YamlError, parse_yaml, read_yaml_text
from strict_yaml.regular_files import open_regular, read_regular, require_regular

__all__ = [
    "LARGEST_TEXT",
    "YamlError",
    "open_regular",
    "parse_yaml",
    "read_regular",
    "read_yaml_text",
    "require_regular",
]
