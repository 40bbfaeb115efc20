"""YAML as the lab takes it, and what is wrong with its content: rigs, campaigns, sweeps and configurations."""

from strict_yaml.reading import LARGEST_TEXT, YamlError, parse_yaml, read_yaml_text
from strict_yaml.regular_files import open_regular, read_regular, require_regular
from strict_yaml.validation import Explanation, explain_validation

__all__ = [
    "LARGEST_TEXT",
    "Explanation",
    "YamlError",
    "explain_validation",
    "open_regular",
    "parse_yaml",
    "read_regular",
    "read_yaml_text",
    "require_regular",
]
